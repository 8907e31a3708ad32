"""Columns of the tip's whole frame: two of its axes become a rotation, mistakes are named by place."""

from __future__ import annotations

import io

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from contid.errors import BadInputError
from contid.kinematics.frames import BaseFrame
from contid.robot_file.base import BasePose
from contid.robot_file.load import load_named
from contid.robot_file.robot import RobotDescription
from contid.targets import Target
from contid.trajectory.read import read_trajectory
from contid.trajectory.timed import Trajectory

HEADER = "t_s,x_mm,y_mm,z_mm,ax,ay,az,bx,by,bz"


def read(text: str, name: str = "tendon3") -> Trajectory:
    robots: dict[str, RobotDescription] = dict(load_named(name).file.robots)
    return read_trajectory(io.StringIO(text), "t.csv", robots)


def rows(turns: Rotation, stretch: float = 1.0, shear: float = 0.0) -> str:
    """Frames as a program may write them: axes of any length, x not across z."""
    lines = [HEADER]
    for k, turn in enumerate(turns.as_matrix()):
        z, x = stretch * turn[:, 2], 3.0 * stretch * (turn[:, 0] + shear * turn[:, 2])
        lines.append(",".join(map(repr, [float(k), 10.0, 0.0, 280.0, *z.tolist(), *x.tolist()])))
    return "\n".join(lines) + "\n"


def frame_at(trajectory: Trajectory, time_s: float) -> np.ndarray:
    target = trajectory.targets_at(time_s)["arm"]
    assert target.rotation is not None
    assert target.direction is None
    return np.reshape(target.rotation, (3, 3))


@pytest.mark.parametrize(("stretch", "shear"), [(1.0, 0.0), (7.0, 0.4), (1e-3, -2.0)])
def test_two_axes_are_the_frame(stretch: float, shear: float) -> None:
    vectors = np.random.default_rng(2).uniform(-1.0, 1.0, (8, 3))
    turns = Rotation.from_rotvec(vectors)
    trajectory = read(rows(turns, stretch, shear))
    for k, turn in enumerate(turns.as_matrix()):
        np.testing.assert_allclose(frame_at(trajectory, float(k)), turn, atol=1e-12)


def test_between_rows_it_stays_a_rotation_and_turns_evenly() -> None:
    turns = Rotation.from_rotvec(np.outer(0.2 * np.arange(5), [0.3, -0.5, 0.8]))
    trajectory = read(rows(turns))
    for time_s in np.linspace(0.0, 4.0, 41):
        found = frame_at(trajectory, float(time_s))
        np.testing.assert_allclose(found @ found.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(found) == pytest.approx(1.0)
        exact = Rotation.from_rotvec(0.2 * time_s * np.array([0.3, -0.5, 0.8]))
        assert (Rotation.from_matrix(found) * exact.inv()).magnitude() < 2e-3


@pytest.mark.parametrize("mirrored", [False, True])
def test_in_the_base_it_is_right_handed_by_the_same_axes(mirrored: bool) -> None:
    base = BasePose(x_mm=5.0, roll_deg=20.0, pitch_deg=-40.0, yaw_deg=70.0, mirror_x=mirrored)
    turn = Rotation.from_euler("xyz", [0.3, 0.5, -0.9]).as_matrix()
    target = Target(tip_m=(0.0, 0.0, 0.2), rotation=tuple(turn.ravel().tolist()))
    in_base = BaseFrame.of(base).target_in_base(target).rotation
    assert in_base is not None
    found, to_base = np.reshape(in_base, (3, 3)), np.reshape(base.rotation, (3, 3)).T
    np.testing.assert_allclose(found[:, [0, 2]], (to_base @ turn)[:, [0, 2]], atol=1e-12)
    assert np.linalg.det(found) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("name", "header", "row", "place", "message"),
    [
        (
            "tendon3",
            HEADER,
            "0,0,0,280,0,0,1,0,0,-2",
            (2, 17),
            "'bx' is zero or parallel to the tip's direction",
        ),
        ("tendon3", HEADER, "0,0,0,280,0,0,1,0,0,0", (2, 17), "'bx' is zero or parallel"),
        ("tendon3", "x_mm,y_mm,z_mm,bx,by,bz", "0,0,280,1,0,0", (1, 1), "no direction (ax, ay, az)"),
        ("tendon3", HEADER[:-3], "0,0,0,280,0,0,1,1,0", (1, 1), "column 'bx' needs 'bz' beside it"),
        (
            "tendon3",
            HEADER,
            "0,0,0,280,0,0,1,1,0,0\n1,0,0,280,0,0,1,-1,0,0",
            (3, 1),
            "the x axis of 'arm' turns by more",
        ),
        ("stiffflop2", HEADER, "0,0,0,80,0,0,1,1,0,0", (1, 29), "unknown column 'bx'"),
    ],
)
def test_a_wrong_frame_is_named_by_place(
    name: str, header: str, row: str, place: tuple[int, int], message: str
) -> None:
    with pytest.raises(BadInputError) as refused:
        read(f"{header}\n{row}\n", name)
    found = refused.value.findings[0]
    assert message in str(refused.value)
    assert found.line == place[0]
    if place[1] > 1:
        assert found.column == place[1], found
