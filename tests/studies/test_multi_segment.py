"""Arms of several segments: the judge, every method's answers, and what the hybrid's joints cost."""

from __future__ import annotations

import math
from itertools import islice

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.spatial.transform import Rotation

from studies import hybrid_joints
from studies.multi_segment import METHODS, TOLERANCES_M, compared, main
from studies.reaching_methods import LARGEST_RAD
from studies.segment_arms import SegmentArm


def integrated(arm: SegmentArm, bends: np.ndarray, pieces: int = 4000) -> tuple[np.ndarray, np.ndarray]:
    """The end by small turns of scipy along every segment, the middle of each piece."""
    position, frame = np.zeros(3), Rotation.identity()
    for u, v in bends:
        s = (np.arange(pieces) + 0.5) / pieces
        turns = Rotation.from_rotvec(s[:, None] * np.array((-v, u, 0.0)))
        along = turns.apply((0.0, 0.0, 1.0)).mean(axis=0) * arm.length_m
        position = position + frame.apply(along)
        frame = frame * Rotation.from_rotvec((-v, u, 0.0))
    return position, frame.apply((0.0, 0.0, 1.0))


@pytest.mark.parametrize("count", [2, 5, 8])
def test_the_judge_is_the_integral_along_the_arm(count: int) -> None:
    arm = SegmentArm(count)
    bends = np.random.default_rng(count).uniform(-2.0, 2.0, (count, 2))
    bends[0] = 0.0
    tip, tangent = arm.end(bends)
    expected_tip, expected_tangent = integrated(arm, bends)
    np.testing.assert_allclose(tip, expected_tip, atol=1e-8)
    np.testing.assert_allclose(tangent, expected_tangent, atol=1e-12)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("direction", [False, True])
def test_a_method_bends_its_way_to_most_poses(method: str, direction: bool) -> None:
    """What the judge accepts is at the goal by the integral of scipy."""
    arm = SegmentArm(5, bend_max_rad=math.radians(60.0))
    met = 0
    for goal in arm.goals(5, direction, seed=1):
        for bends in islice(METHODS[method](arm, goal), 200):
            if arm.error_m(bends, goal) > 1e-3:
                continue
            tip, tangent = integrated(arm, bends, 400)
            np.testing.assert_allclose(tip, goal.tip, atol=1.1e-3)
            if goal.direction is not None:
                np.testing.assert_allclose(tangent, goal.direction, atol=1.1e-2)
            met += 1
            break
    assert met >= 3


@pytest.mark.parametrize("method", ["FABRIKc", "CRRIK"])
def test_links_stay_finite_at_poses_out_of_reach(method: str) -> None:
    arm = SegmentArm(2)
    for tip in ((0.0, 0.0, -0.5), (0.0, 0.0, 0.0), (0.0, 0.0, 0.5), (0.01, 0.0, -0.01)):
        (goal,) = arm.goals(1, True, 0)
        for bends in islice(METHODS[method](arm, goal._replace(tip=tip)), 50):
            assert np.all(np.hypot(*bends.T) <= LARGEST_RAD + 1e-9)


def test_every_method_is_in_the_table_and_contid_meets_every_pose() -> None:
    rows = compared(SegmentArm(3), cases=2, direction=True, seed=2, most=60)
    names = {row.method for row in rows}
    assert {"contid, kernel", *METHODS} <= names
    assert len(rows) == len(names) * len(TOLERANCES_M)
    assert all(row.met == 1.0 for row in rows if row.method.startswith("contid"))
    assert all(len(row.iterations) == len(row.times_ms) <= row.cases for row in rows)


def test_the_short_form() -> None:
    result = CliRunner().invoke(main, ["--cases", "1", "--segments", "2", "--iterations", "20"])
    assert result.exit_code == 0, result.output
    assert result.output.count("| 2 | tip |") >= 1 + len(METHODS)
    wrong = CliRunner().invoke(main, ["--segments", "1-3"])
    assert wrong.exit_code == 2
    assert "allowed: 2 to 8" in wrong.output


@pytest.mark.parametrize(("joints", "error_mm"), [(4, 12.9), (8, 6.47), (16, 3.24), (32, 1.62)])
def test_joints_below_their_prismatic_piece_displace_the_tip(joints: int, error_mm: float) -> None:
    """Figures of the reference for L = 125 mm, u = 0.8, v = 0.3."""
    arm = SegmentArm(1, length_m=0.125)
    tip, _ = arm.end(np.array([[0.8, 0.3]]))
    off = hybrid_joints.joint_chain(np.array([[0.8, 0.3, 0.125]]), joints) - tip
    assert 1e3 * np.linalg.norm(off) == pytest.approx(error_mm, rel=5e-3)


def test_the_error_of_the_joints_is_that_of_their_number() -> None:
    few, many = hybrid_joints.sensitivity(8), hybrid_joints.sensitivity(16)
    assert many.mean_mm == pytest.approx(0.5 * few.mean_mm, rel=0.1)
