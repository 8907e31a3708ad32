"""`Robot` against the command line in another process, finite differences and plain geometry."""

from __future__ import annotations

import csv
import io
import math

import numpy as np
import pytest

from contid import Robot
from contid.errors import ContidError
from tests.support.command import contid

RARE = pytest.mark.campaign
ARMS = [
    ("finger", None), ("hand", "right"), ("trirack", None), ("trirack2", None), ("cbha", None),
    ("tendon3", None), ("chain", "left"), ("stiffflop1", None), ("stiffflop2", None),
]  # fmt: skip
#: Of each a process is started: one in the plane, one of a pair, one of two sections, one of elastic rods.
FEW = [
    pytest.param(*arm, marks=() if arm[0] in ("finger", "hand", "trirack2", "stiffflop2") else RARE)
    for arm in ARMS
]


def arm(name: str, which: str | None, si: bool = False) -> Robot:
    robot = Robot(name, si=si)
    return robot[which] if which else robot


def actuations(robot: Robot, count: int) -> np.ndarray:
    """Inside the limits: the answers to the tips of random actuations."""
    rng = np.random.default_rng(19)
    low, high = robot.limits.min, robot.limits.max
    some = rng.uniform(low + 0.3 * (high - low), low + 0.6 * (high - low), (count, len(low)))
    return np.array(robot.ik(robot.fk(some).tip).actuation)


def command(*arguments: str, rows: str) -> list[dict[str, str]]:
    done = contid(*arguments, stdin=rows)
    assert done.returncode == 0, done.stderr
    return list(csv.DictReader(io.StringIO(done.stdout)))


def table(columns: tuple[str, ...], rows: np.ndarray) -> str:
    return ",".join(columns) + "\n" + "".join(",".join(map(repr, row)) + "\n" for row in rows.tolist())


@pytest.mark.process
@pytest.mark.parametrize(("name", "which"), FEW)
def test_fk_and_ik_have_the_bits_of_the_command_line(name: str, which: str | None) -> None:
    robot = arm(name, which)
    front = f"{which}." if which else ""
    rows = actuations(robot, 6)
    poses = robot.fk(rows)
    axes = tuple(front + axis for axis in robot.axes)
    coordinates = tuple(f"{front}{axis}_mm" for axis in "xyz"[: robot.dimension])
    printed = command("fk", name, rows=table(axes, rows))
    assert [[float(row[c]) for c in coordinates] for row in printed] == poses.tip.tolist()
    targets = poses.tip + np.array([3.0, -2.0, 1.0])[: robot.dimension]
    found = robot.ik(targets, seed="previous")
    printed = command("ik", name, rows=table(coordinates, targets))
    assert [[float(row[c]) for c in axes] for row in printed] == found.actuation.tolist()
    assert [float(row[f"{front}residual_mm"]) for row in printed] == found.residual.tolist()
    assert [row[f"{front}converged"] for row in printed] == [str(v).lower() for v in found.converged.tolist()]
    for row, bits in zip(printed, found.limited_by, strict=True):
        assert set(row[f"{front}limited_by"].split()) == set(robot.limits_in(bits))


@pytest.mark.parametrize(("name", "which"), ARMS)
def test_the_inverse_undoes_the_forward_in_any_shape_of_rows(name: str, which: str | None) -> None:
    robot = arm(name, which)
    rows = actuations(robot, 6).reshape(2, 3, -1)
    tips = robot.fk(rows).tip
    answer = robot.ik(tips)
    assert answer.shape == (2, 3)
    assert answer.converged.all()
    assert robot.fk(answer.actuation).tip == pytest.approx(tips, abs=1e-3)
    one = robot.ik(tips[1, 2])
    assert one.shape == ()
    assert one.actuation.tolist() == answer.actuation[1, 2].tolist()
    assert robot.ik(tips[:0]).shape == (0, 3)


@pytest.mark.parametrize(("name", "which"), ARMS)
@pytest.mark.parametrize("si", [False, True])
def test_the_jacobian_is_the_derivative_of_the_tip(name: str, which: str | None, si: bool) -> None:
    robot = arm(name, which, si)
    rows = actuations(robot, 3)
    found = robot.jacobian(rows)
    step = 1e-5 * float(np.max(robot.limits.max))
    for axis in range(rows.shape[1]):
        moved = np.zeros(rows.shape[1])
        moved[axis] = step
        slope = (robot.fk(rows + moved).tip - robot.fk(rows - moved).tip) / (2.0 * step)
        assert found[..., axis] == pytest.approx(slope, rel=2e-3, abs=2e-4 * np.abs(found).max())


@pytest.mark.parametrize(("name", "which"), ARMS)
def test_the_backbone_runs_from_the_base_to_the_tip(name: str, which: str | None) -> None:
    robot = arm(name, which)
    rows = actuations(robot, 4)
    lines = robot.backbone(rows, 200)
    base = robot.description.base
    assert lines.shape == (4, 200, robot.dimension)
    assert lines[:, 0] == pytest.approx(
        np.tile([base.x_mm, base.y_mm, base.z_mm][: robot.dimension], (4, 1)), abs=1e-9
    )
    poses = robot.fk(rows)
    assert lines[:, -1] == pytest.approx(poses.tip, abs=1e-6)
    end = lines[:, -1] - lines[:, -2]
    # The chord at the tip turns towards the tangent as its length shrinks.
    cosine = (end * poses.direction).sum(axis=1) / np.linalg.norm(end, axis=1)
    assert cosine == pytest.approx(np.ones(4), abs=1e-3)
    lengths = np.linalg.norm(np.diff(lines, axis=1), axis=2)
    assert lengths == pytest.approx(
        np.broadcast_to(lengths.mean(axis=1, keepdims=True), lengths.shape), rel=0.02
    )


def test_a_straight_finger_and_a_quarter_circle_are_plain_geometry() -> None:
    finger = Robot("finger")
    assert finger.fk([70.0, 70.0]).tip.tolist() == pytest.approx([0.0, 92.0])
    # Turning angle pi/2 by (right - left)/13 * (1 + 0.0013 S - 0.2774), S = 60, then a straight tip of 22 mm.
    spread = 13.0 * (math.pi / 2) / (1.0 + 0.0013 * 60.0 - 0.2774)
    radius = 60.0 / (math.pi / 2)
    tip = finger.fk([60.0 - spread / 2, 60.0 + spread / 2])
    assert tip.tip.tolist() == pytest.approx([radius + 22.0, radius])
    assert tip.direction.tolist() == pytest.approx([1.0, 0.0], abs=1e-12)


def test_the_base_pose_and_the_mirror_are_applied() -> None:
    hand = Robot("hand")
    rows = actuations(hand["left"], 5)
    left, right = hand["left"].fk(rows), hand["right"].fk(rows)
    assert right.tip[:, 0] == pytest.approx(100.0 - left.tip[:, 0])
    assert right.tip[:, 1] == pytest.approx(left.tip[:, 1])
    assert right.direction[:, 0] == pytest.approx(-left.direction[:, 0])
    jacobians = hand["right"].jacobian(rows)
    assert jacobians[:, 0] == pytest.approx(-hand["left"].jacobian(rows)[:, 0])


@pytest.mark.parametrize(("name", "per_si"), [("trirack2", 1e-3), ("stiffflop2", 1e5)])
def test_si_is_the_same_in_other_units(name: str, per_si: float) -> None:
    edge, si = Robot(name), Robot(name, si=True)
    rows = actuations(edge, 4)
    pose, pose_si = edge.fk(rows), si.fk(rows * per_si)
    assert pose_si.tip == pytest.approx(pose.tip / 1e3)
    assert pose_si.rotation == pytest.approx(pose.rotation)
    answer, answer_si = edge.ik(pose.tip), si.ik(pose.tip / 1e3)
    assert answer_si.actuation == pytest.approx(answer.actuation * per_si, rel=1e-6)
    assert si.limits.max == pytest.approx(edge.limits.max * per_si)
    assert si.limits.velocity == pytest.approx(edge.limits.velocity * per_si)
    assert (edge.units.length, si.units.length) == ("mm", "m")
    assert si.axes[0].endswith("_m" if per_si < 1 else "_Pa")


def test_directions_of_any_length_and_one_row_for_all() -> None:
    robot = Robot("cbha")
    poses = robot.fk(actuations(robot, 3))
    each = robot.ik(poses.tip, direction=poses.direction * [[2.0], [1e-200], [1e9]])
    assert each.converged.all()
    assert robot.fk(each.actuation).direction == pytest.approx(poses.direction, abs=1e-4)
    both = robot.ik(poses.tip, direction=poses.direction[0])
    assert (
        both.actuation[0].tolist() == robot.ik(poses.tip[0], direction=poses.direction[0]).actuation.tolist()
    )


def test_mid_points_and_loads_reach_the_model() -> None:
    robot = Robot("stiffflop2")
    rows = actuations(robot, 2)
    force = np.array([0.0, 0.003, 0.01])
    loaded = robot.fk(rows, load=force)
    assert np.linalg.norm(loaded.tip - robot.fk(rows).tip, axis=1).min() > 0.05
    answer = robot.ik(loaded.tip, mid=loaded.mid, load=force, seed=rows)
    assert answer.converged.all()
    again = robot.fk(answer.actuation, load=force)
    assert again.tip == pytest.approx(loaded.tip, abs=0.05)
    assert again.mid == pytest.approx(loaded.mid, abs=0.05)


def test_out_of_reach_is_a_row() -> None:
    robot = Robot("finger")
    answer = robot.ik([[0.0, 92.0], [0.0, 500.0], [1e9, 0.0]])
    assert answer.converged.tolist() == [True, False, False]
    assert answer.residual[1] == pytest.approx(500.0 - 122.0)
    assert robot.limits_in(answer.limited_by[1]) == ("left.max", "right.max")
    assert robot.limits_in(answer.limited_by[0]) == ()
    assert (answer.actuation <= robot.limits.max).all()


def test_rows_without_previous_do_not_depend_on_each_other() -> None:
    robot = Robot("trirack2")
    tips = robot.fk(actuations(robot, 5)).tip
    forward, backward = robot.ik(tips), robot.ik(tips[::-1])
    assert forward.actuation.tolist() == backward.actuation[::-1].tolist()
    follow = robot.ik(tips, seed="previous")
    step = robot.ik(tips[3], seed=follow.actuation[2])
    assert follow.actuation[3].tolist() == step.actuation.tolist()


@pytest.mark.parametrize("si", [False, True])
def test_bends_of_sections_lead_to_axes_and_back(si: bool) -> None:
    robot = Robot("cbha", si=si)
    unit = np.array([math.pi / 180.0, math.pi / 180.0, 1e-3] * 2) if si else np.ones(6)
    bends = unit * np.array([[10.0, 30.0, 120.0, 5.0, -40.0, 112.0], [5.0, 0.0, 125.0, 2.0, 90.0, 110.0]])
    assert robot.bend_columns[0] == ("s1.bend_rad" if si else "s1.bend_deg")
    found = robot.ik_bends(bends)
    assert found.converged.all()
    np.testing.assert_allclose(robot.bends(found.actuation), bends, atol=1e-9)
    assert robot.ik_bends(bends[0]).actuation.tolist() == found.actuation[0].tolist()
    beyond = robot.ik_bends(unit * np.array([300.0, 0.0, 120.0, 0.0, 0.0, 112.0]))
    assert not beyond.converged
    assert robot.limits_in(int(beyond.limited_by))
    with pytest.raises(ContidError, match=r"expected: \(6,\) or \(N, 6\) with columns s1.bend_"):
        robot.ik_bends([1.0, 2.0])
