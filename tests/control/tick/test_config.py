"""What follows from the configuration of a robot."""

from __future__ import annotations

from dataclasses import replace

import pytest

from contid.control.tick.config import FeedbackConfig, _loops, robot_config
from contid.control.tick.transmission import RobotTransmission
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.load import load_named
from contid.robot_file.pneumatic.sense import LoadSensing, ModelErrors, Sense
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


def test_a_loop_of_a_chamber_that_leads_is_none() -> None:
    """Of a calibration of the robot: half the loops in bar, negative where the pressure lags."""
    robot = load_named("stiffflop2").file.robots["arm"]
    assert isinstance(robot, Cosserat)
    half = (-0.02, 0.03, 0.0, -0.001, 0.5, -0.3)
    errors = ModelErrors(
        offset_bar=(0.0,) * 6, gain=(0.0,) * 6, loop_bar=half, modulus=(0.0,) * 2, moment=(0.0,) * 2,
        axis_sigma_bar=0.0, tip_sigma_mm=0.0, covariance_factor=((0.0,),), corrects="robot",
    )  # fmt: skip
    calibrated = robot.model_copy(update={"sense": Sense(load=LoadSensing(calibration=errors))})
    assert _loops(calibrated) == pytest.approx((2e3, 0.0, 0.0, 1e2, 0.0, 3e4))
    assert _loops(robot) is None


def test_a_bus_without_a_watchdog_does_not_hide_that_of_another() -> None:
    loaded = load_named("hand")
    name, robot = next(iter(loaded.driven.items()))
    left, right = robot.all_axis_names
    axes = {left: robot.axes[left], right: robot.axes[right].model_copy(update={"bus": "other"})}
    apart = robot.model_copy(update={"axes": axes})
    bus = robot.axes[left].bus

    def watchdog_s(of_bus: float, of_other: float) -> float:
        config = robot_config(
            name, apart, RobotTransmission(apart), 200.0, {bus: 5, "other": 5},
            {bus: of_bus, "other": of_other},
        )  # fmt: skip
        return config.watchdog_s

    assert [watchdog_s(*each) for each in ((0.2, 0.0), (0.0, 0.2), (0.3, 0.2), (0.0, 0.0))] == [0.2] * 3 + [
        0.0
    ]
