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
        most = preflight._greatest_way_m(config.name, (here, ZERO3), (goal, ZERO3))
        still = (0.0,) * len(here)
        motion = motion_to(config, here, PresentRates(still, still), goal)
        gone, last = 0.0, here
        speed = guard.arms[config.name].speed
        for k in range(1, int(motion.duration_s / config.period_s) + 1):
            at, velocity = motion.at(k * config.period_s)
            gone += guard.arms[config.name].motion_m(last, at)
            stop = straight_stop(config, at, tuple([v * config.period_s for v in velocity]))
            assert gone + sum(s * d for s, d in zip(speed, stop.distances, strict=True)) <= most
            last = at
        assert guard.arms[config.name].motion_m(here, goal) <= most
