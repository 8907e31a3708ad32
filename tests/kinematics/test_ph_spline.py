"""Several quintics as one curve."""

from __future__ import annotations

import numpy as np
import pytest

from contid_ropes.ph.ends import CurveEnds, through
from contid_ropes.ph.quintic import points_at
from tests.kinematics.ph_golden import DISTANCE, golden_lengths, section_pose, two_section_pose

Z = (0.0, 0.0, 1.0)


def test_equal_arc_length_runs_across_joints() -> None:
    along = (0.25, 0.0, 1.0)
    first = through(CurveEnds((0, 0, 0), (0.1, 0, 0.2), along, along)).curve
    second = through(CurveEnds((0.1, 0, 0.2), (0.3, 0, 0.3), along, along)).curve
    pieces, length = (first, second), first.length_m + second.length_m
    points = points_at(pieces, np.linspace(0.0, length, 4001))
    chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
    assert chords.sum() == pytest.approx(length, rel=1e-6)
    assert np.ptp(chords) < 1e-5 * chords.mean()
    assert points_at(pieces, np.array([-1.0, 9.0])) == pytest.approx(
        np.array([[0, 0, 0], [0.3, 0, 0.3]]), abs=1e-15
    )


def test_one_piece_per_section_is_an_arm_of_constant_curvature() -> None:
    """Reference E.3: the floor of a single quintic is the step of curvature at the section joint."""
    worst = 0.0
    for row in golden_lengths(12):
        tip, tangent, mid = (tuple(v.tolist()) for v in two_section_pose(row))
        _, first = section_pose(row[:3], DISTANCE[0])
        lengths, middle = (float(row[:3].mean()), float(row[3:].mean())), tuple(first[:, 2].tolist())
        lower = through(CurveEnds((0, 0, 0), mid, Z, middle), lengths[0]).curve
        upper = through(CurveEnds(mid, tip, middle, tangent), lengths[1]).curve
        share = np.linspace(0.0, 1.0, 21)
        # A section cut at a share of itself: its tubes are that share of their lengths.
        truth = [section_pose(row[:3] * part, DISTANCE[0])[0] for part in share]
        truth += [np.array(mid) + first @ section_pose(row[3:] * part, DISTANCE[1])[0] for part in share]
        s = np.concatenate([share * lengths[0], lengths[0] + share * lengths[1]])
        worst = max(
            worst,
            float(
                np.linalg.norm(points_at((lower, upper), s) - np.array(truth), axis=1).max() / sum(lengths)
            ),
        )
    assert worst < 1e-4
