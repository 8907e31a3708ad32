"""Axes beyond the kinematics: columns, strokes, no effect on the tip."""

from __future__ import annotations

import io
import math
from pathlib import Path

import numpy as np
import pytest

from contid.control.engine.virtual import run_virtual
from contid.kinematics.extra_axes import WithExtraAxes, build_whole_model
from contid.kinematics.model import Compliant, build_model
from contid.robot_file.load import load_robot_file, with_mock
from contid.targets import Target
from contid.trajectory.read import read_trajectory
from tests.support.fingers import Collector


def test_extra_axes_follow_their_columns_inside_their_strokes(configs: Path) -> None:
    robot = load_robot_file(configs / "cbha.yaml").file.robots["cbha"]
    model = build_whole_model(robot)
    assert model.axis_names[-2:] == ("wrist", "gripper")
    seed = (*robot.rest, 0.001, 0.002)
    tip = model.forward(seed).tip_m
    kept = model.inverse(Target(tip_m=tip, extra={"gripper": 0.007}), seed)
    assert kept.converged
    assert kept.actuation[-2:] == (0.001, 0.007)
    beyond = model.inverse(Target(tip_m=tip, extra={"gripper": 0.02, "wrist": -1.0}), seed)
    assert not beyond.converged
    assert beyond.actuation[-2:] == (0.0, 0.01)
    assert {"gripper.max", "wrist.min"} <= set(beyond.limited_by)
    alone = model.inverse(Target(extra={"wrist": 0.003}), seed)
    assert alone.actuation == (*robot.rest, 0.003, 0.002)
    assert (model.jacobian(seed)[:, -2:] == 0).all()


def test_an_extra_axis_that_is_not_a_number_holds_the_robot(configs: Path) -> None:
    robot = load_robot_file(configs / "cbha.yaml").file.robots["cbha"]
    model = build_whole_model(robot)
    seed = (*robot.rest, 0.001, 0.002)
    tip = model.forward(seed).tip_m
    for target in (Target(extra={"gripper": math.nan}), Target(tip_m=tip, extra={"wrist": math.nan})):
        found = model.inverse(target, seed)
        assert found.actuation == seed
        assert (found.converged, found.limited_by) == (False, ("not_finite",))
    endless = model.inverse(Target(extra={"gripper": math.inf}), seed)
    assert (endless.actuation[-1], endless.limited_by) == (0.01, ("gripper.max",))


def test_a_gripper_moves_through_the_whole_chain(configs: Path) -> None:
    loaded = with_mock(load_robot_file(configs / "cbha.yaml"))
    text = "t_s,x_mm,y_mm,z_mm,gripper_mm\n0,20,0,240,0\n2,30,10,240,8\n"
    trajectory = read_trajectory(io.StringIO(text), "t.csv", loaded.file.robots)
    seen = Collector(loaded)
    report = run_virtual(loaded, 100.0, trajectory, sinks=[seen])
    assert report.exit_code == 0
    last = seen.records[-1].robots[0].axes[-1]
    assert last.command == pytest.approx(0.008, abs=1e-6)
    asked = [record.robots[0].axes[-1].target for record in seen.records]
    assert max(value for value in asked if value == value) == pytest.approx(0.008, abs=1e-12)
    assert last.valid == 1.0
    assert last.value == pytest.approx(last.device, rel=0.05)


def test_an_arm_with_extra_axes_is_as_compliant_as_without(configs: Path) -> None:
    robot = load_robot_file(configs / "stiffflop1.yaml").file.robots["arm"]
    model = WithExtraAxes(build_model(robot), ("gripper",), {"gripper": (0.0, 0.01)})
    assert isinstance(model, Compliant)
    pressures, load_n = (5e4, 7e4, 6e4), (0.01, 0.0, 0.02)
    own = build_model(robot)
    assert isinstance(own, Compliant)
    np.testing.assert_array_equal(
        model.compliance((*pressures, 0.005), load_n), own.compliance(pressures, load_n)
    )
    finger = load_robot_file(configs / "finger.yaml").file.robots
    stiff = WithExtraAxes(build_model(next(iter(finger.values()))), ("gripper",), {"gripper": (0.0, 0.01)})
    assert not isinstance(stiff, Compliant)
