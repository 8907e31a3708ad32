"""The whole frame of the tip as a target: six numbers for six bends."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from contid import Robot
from contid.api.arguments import ArgumentError
from contid.targets import Target
from studies.arc_chains import turn_left
from tests.kinematics.tendon_robots import frame_of, placed, random_bends, shipped, vec


@pytest.mark.parametrize("name", ["tendon3", "ftdcr_v4"])
def test_every_frame_that_can_be_reached_is_met(name: str) -> None:
    model = shipped(name)
    assert model.statics is not None
    seed = (0.0,) * model.geometry.tendons
    for bends in random_bends(model, 80, seed=31):
        tip, _, _ = placed(model, bends)
        frame = frame_of(model, bends)
        found = model.inverse(Target(tip_m=vec(tip), rotation=tuple(frame.ravel().tolist())), seed)
        assert found.converged
        reached = model.bends(found.actuation)
        np.testing.assert_allclose(placed(model, reached)[0], tip, atol=1e-6)
        off = Rotation.from_matrix(frame_of(model, reached) @ frame.T).magnitude()
        assert off < 2e-5
        assert np.min(model.statics.tensions(np.array(found.actuation))) >= model.statics.floor_n - 1e-6


def test_roll_that_no_bend_gives_leaves_a_residual() -> None:
    """Straight up with a quarter turn about the backbone: the tip gives way."""
    model = shipped()
    height = model.forward((0.0,) * 9).tip_m[2]
    quarter = (0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    found = model.inverse(Target(tip_m=(0.0, 0.0, height), rotation=quarter), (0.0,) * 9)
    assert not found.converged
    assert found.residual_m > 0.01
    assert "leaves" in found.note


def test_the_turn_left_is_the_rotation_vector_of_scipy() -> None:
    rng = np.random.default_rng(5)
    for angle in (0.0, 1e-9, 1e-4, 1.0, 3.0, math.pi - 1e-9, math.pi):
        axis = rng.normal(size=3)
        phi = angle * axis / np.linalg.norm(axis)
        at = Rotation.random(random_state=7)
        got = turn_left((Rotation.from_rotvec(phi) * at).as_matrix(), at.as_matrix())
        off = (Rotation.from_rotvec(got) * Rotation.from_rotvec(phi).inv()).magnitude()
        assert off == pytest.approx(0.0, abs=2e-8)
        assert np.linalg.norm(got) == pytest.approx(angle, abs=2e-8)


@pytest.mark.parametrize("name", ["tendon3", "trirack2", "cbha"])
def test_the_library_meets_frames_in_the_world(name: str) -> None:
    robot = Robot(name)
    high = np.linalg.norm(robot.fk(robot.ik([0.0, 0.0, 1e3]).actuation).tip)
    away = high * np.random.default_rng(8).uniform((-0.2, -0.2, 0.8), (0.2, 0.2, 0.9), (6, 3))
    there = robot.fk(robot.ik(away).actuation)  # inside every limit
    found = robot.ik(there.tip, rotation=there.rotation)
    assert found.converged.all()
    reached = robot.fk(found.actuation)
    np.testing.assert_allclose(reached.tip, there.tip, atol=1e-3)
    np.testing.assert_allclose(reached.rotation, there.rotation, atol=1e-4)


@pytest.mark.parametrize(
    ("name", "given", "message"),
    [
        ("tendon3", {"rotation": np.zeros((3, 3))}, "row 0 is no rotation matrix"),
        ("tendon3", {"rotation": [0, 0, 1]}, r"allowed: \(3, 3\)"),
        ("tendon3", {"rotation": np.diag([1.0, 1.0, -1.0])}, "hand of this robot"),
        ("tendon3", {"rotation": np.eye(3), "direction": [0, 0, 1]}, "leave out direction"),
        ("stiffflop2", {"rotation": np.eye(3)}, "takes no rotation"),
    ],
)
def test_wrong_frames_are_refused(name: str, given: dict[str, object], message: str) -> None:
    with pytest.raises(ArgumentError, match=message):
        Robot(name).ik([10.0, 10.0, 250.0], **given)  # type: ignore[arg-type]  # that is the test
