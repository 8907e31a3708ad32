"""A row is not walked through where its greatest way leaves room: that bound against the motion itself."""

from __future__ import annotations

import numpy as np
import pytest

from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.axis_motions import PresentRates, motion_to, straight_stop
from contid.robot_file.load import load_named
from contid.targets import ZERO3
from contid_clearance.file_clearance import clearance_guard
from contid_clearance.preflight import ClearancePreflight


@pytest.mark.parametrize("seed", range(3))
def test_the_greatest_way_of_a_row_is_above_any_way_of_its_motion_and_of_a_stop_from_it(seed: int) -> None:
    """Along the motion to the row in steps of the tick, with the stop that may begin at each."""
    loaded, draw = load_named("hand"), np.random.default_rng(seed)
    guard = clearance_guard(loaded)
    assert guard is not None
    configs = build_robot_configs(loaded, loaded.file.rate_hz)
    preflight, config = ClearancePreflight(guard, configs, {}), configs[0]
    low, high = np.array(config.model.lower), np.array(config.model.upper)
    for length in (1e-5, 1e-3, 1.0):
        start = draw.uniform(low, high)
        goal = tuple(np.clip(start + length * draw.uniform(low - high, high - low), low, high).tolist())
        here = tuple(start.tolist())
        most = preflight._greatest_motion(config.name, (here, ZERO3), (goal, ZERO3))
        still = (0.0,) * len(here)
        motion = motion_to(config, here, PresentRates(still, still), goal)
        arm, last = guard.arms[config.name], here
        gone = np.zeros(2)
        for k in range(1, int(motion.duration_s / config.period_s) + 1):
            at, velocity = motion.at(k * config.period_s)
            gone += arm.motion([abs(b - a) for a, b in zip(last, at, strict=True)])
            stop = straight_stop(config, at, tuple([v * config.period_s for v in velocity]))
            assert np.all(gone + arm.motion(stop.distances) <= most)
            last = at
        assert arm.motion_m(here, goal) <= most.way_m
