"""Whole frames in the tick: followed, and approached after a jump of a live target."""

from __future__ import annotations

import numpy as np
import pytest

from contid.control.tick.robot_tick import tick
from contid.control.tick.state import RobotState
from contid.control.tick.supervisor import Mode
from contid.hal import Sample
from contid.targets import Target
from tests.support.robot_configs import config_of, postures


@pytest.mark.parametrize("name", ["tendon3", "trirack2", "cbha"])
def test_a_jump_of_a_live_frame_is_met(name: str) -> None:
    config, rng = config_of(name), np.random.default_rng(5)
    low, high = (0.48, 0.53) if name == "tendon3" else (0.3, 0.6)
    for _ in range(3):
        start, _ = postures(config, rng, low, high)
        goal, _ = postures(config, rng, low, high)
        pose = config.model.forward(goal)
        target = config.frame.target_in_base(Target(tip_m=pose.tip_m, rotation=pose.rotation))
        assert config.model.inverse(target, start).converged
        still = (0.0,) * len(start)
        state = RobotState(
            mode=Mode.RUN, enabled=True, arm_requested=True, follow=True, command=start, reference=start,
            increments=still, misses=(0,) * len(start),
        )  # fmt: skip
        samples = tuple(Sample(value, 0.0, True, 0.0) for value in config.transmission.to_device(start))
        asked = Target(tip_m=config.frame.point_in_world(pose.tip_m), rotation=pose.rotation)
        for k in range(1500):
            out = tick(config, state, 0.01 * k, samples, asked)
            state = out.state
            assert state.message == ""
            if out.tip_error_m < 1e-9 and max(map(abs, state.increments)) < 1e-9:
                break
        found = config.model.forward(state.command)
        assert np.abs(np.subtract(found.tip_m, pose.tip_m)).max() < 1e-6
        assert np.abs(np.subtract(found.rotation, pose.rotation)).max() < 1e-4
