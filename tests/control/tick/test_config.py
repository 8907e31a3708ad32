"""What follows from the configuration of a robot."""

from __future__ import annotations

from dataclasses import replace

import pytest

from contid.control.tick.config import FeedbackConfig
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.shipped import load_named
from tests.support.robot_configs import config_of

FEEDBACK = FeedbackConfig(gain_per_s=1.0, limit_m=0.01, stale_s=0.1, fade_s=0.5)


@pytest.mark.parametrize("load", ["measured", "estimated", None])
@pytest.mark.parametrize("feedback", [FEEDBACK, None])
def test_measurements_move_targets_by_feedback_or_an_estimated_load(
    load: str | None, feedback: FeedbackConfig | None
) -> None:
    robot = load_named("stiffflop2").file.robots["arm"]
    assert isinstance(robot, Cosserat)
    sensing = None if load is None else robot.model_copy(update={"load": load})
    config = replace(config_of("stiffflop2"), sensing=sensing, feedback=feedback)
    assert config.measurements_move_targets == (feedback is not None or load == "estimated")
