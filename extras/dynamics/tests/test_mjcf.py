"""Exported models in MuJoCo: static shapes, and the first frequency from its own mass and forces."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import eigh

from contid.kinematics.array import Array
from contid.kinematics.model import build_model
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.load import load_named
from contid.robot_file.tendon.robot import TendonRobot
from contid.targets import Target
from contid_dynamics.mjcf import mjcf
from contid_dynamics.report import pose_modes

mujoco: Any = pytest.importorskip("mujoco", reason="pip install 'contid[test]'")

STEP = 1e-6


def robot_of(name: str) -> Cosserat | TendonRobot:
    (robot,) = load_named(name).file.robots.values()
    assert isinstance(robot, (Cosserat, TendonRobot))
    return robot


def actuation_of(robot: Cosserat | TendonRobot) -> list[float]:
    if isinstance(robot, Cosserat):
        return [0.8e5, 0.1e5, 0.0, 0.2e5, 0.7e5, 0.0][: len(robot.axis_names)]
    model = build_model(robot)
    pose = model.forward((4e-3, -2e-3, -2e-3, 2e-3, -3e-3, 1e-3, 1e-3, 1e-3, -2e-3))
    found = model.inverse(Target(tip_m=pose.tip_m, direction=pose.direction), robot.rest)
    assert found.converged
    return list(found.actuation)


def forces(model: Any, data: Any, qpos: Array) -> Array:
    """What springs, weight and actuators push at rest."""
    data.qpos[:], data.qvel[:] = qpos, 0.0
    mujoco.mj_forward(model, data)
    pushed: Array = data.qfrc_passive + data.qfrc_actuator - data.qfrc_bias
    return pushed.copy()


def derivative(model: Any, data: Any, qpos: Array) -> Array:
    columns = []
    for k in range(len(qpos)):
        step = np.zeros(len(qpos))
        step[k] = STEP
        columns.append((forces(model, data, qpos - step) - forces(model, data, qpos + step)) / (2.0 * STEP))
    return np.stack(columns, axis=1)


@pytest.mark.parametrize("name", ["stiffflop1", "stiffflop2", "tendon3", "ftdcr_v4"])
def test_shape_and_first_frequency_are_those_of_the_robot(name: str) -> None:
    robot = robot_of(name)
    actuation = actuation_of(robot)
    model = mujoco.MjModel.from_xml_string(mjcf(robot, "arm", actuation))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    qpos = data.qpos.copy()
    for _ in range(10):  # Newton's method on MuJoCo's own forces
        if np.abs(forces(model, data, qpos)).max() < 1e-10:
            break
        qpos = qpos + np.linalg.solve(derivative(model, data, qpos), forces(model, data, qpos))
    assert np.abs(forces(model, data, qpos)).max() < 1e-9
    expected = np.array(build_model(robot).forward(tuple(actuation)).tip_m)
    length = float(np.linalg.norm(build_model(robot).forward(robot.rest).tip_m))
    assert np.linalg.norm(data.site("tip").xpos - expected) < 0.01 * length
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    stiffness = derivative(model, data, qpos)
    found_hz = np.sqrt(eigh(0.5 * (stiffness + stiffness.T), mass, eigvals_only=True)[0]) / (2.0 * np.pi)
    first = pose_modes(robot, actuation, 1).modes[0]
    assert found_hz == pytest.approx(first.frequency_hz / np.sqrt(1.0 - first.ratio**2), rel=0.03)


def test_a_second_in_mujoco_stays_at_rest() -> None:
    robot = robot_of("tendon3")
    model = mujoco.MjModel.from_xml_string(mjcf(robot, "arm", actuation_of(robot), elements=3))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    before = data.site("tip").xpos.copy()
    while data.time < 0.2:
        mujoco.mj_step(model, data)
    assert np.linalg.norm(data.site("tip").xpos - before) < 3e-3


@pytest.mark.process
def test_the_command_writes_a_model_or_names_what_is_wrong(
    contid: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path
) -> None:
    done = contid("export", "mjcf", "tendon3", "--at", "s1.t1_mm=3", "-o", "arm.xml")
    assert done.returncode == 0, done.stderr
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml")).nu == 9
    assert contid("export", "mjcf", "finger").returncode == 2
    wrong = contid("export", "mjcf", "tendon3", "--robot", "left")
    assert wrong.returncode == 2
    assert "allowed: arm" in wrong.stderr
