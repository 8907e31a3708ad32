"""Geometry of tendon robots against integrated rods and rotation matrices of scipy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from contid.kinematics.tendon.geometry import TendonGeometry, TendonSection, forward
from tests.support.tendon_sections import even_section

UNEVEN = TendonGeometry(
    (
        TendonSection(0.060, (0.0045, 0.0045, 0.0050), (-3.06, -1.0, 1.07), 0.002),
        TendonSection(0.0625, (0.0045, 0.0044, 0.0046, 0.0045), (0.1, 1.6, 3.2, 4.8)),
        even_section(0.064, 0.0045, 3, -2.05, 0.003),
    ),
    base_offset_m=0.01,
    tip_offset_m=(0.001, -0.002, 0.004),
)


def travelled(geometry: TendonGeometry, bends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tip, and the shortening of every tendon, by integrating frames and the tendons' own curves."""
    position, rotation = np.array([0.0, 0.0, geometry.base_offset_m]), np.eye(3)
    shortened = np.zeros(geometry.tendons)
    slices = geometry.tendon_slices
    for k, section in enumerate(geometry.sections):
        u, v = bends[2 * k : 2 * k + 2]
        turn = np.array([-v, u, 0.0]) / section.length_m  # angular velocity per length, in the local frame
        offsets = [
            (i, np.array([d * math.cos(a), d * math.sin(a), 0.0]))
            for j in range(k, geometry.count)
            for i, d, a in zip(
                range(slices[j].start, slices[j].stop),
                geometry.sections[j].radius_m,
                geometry.sections[j].angle_rad,
                strict=True,
            )
        ]

        def rates(_: float, state: np.ndarray, turn=turn, offsets=offsets) -> np.ndarray:
            r = state[3:12].reshape(3, 3)
            spin = np.array([[0, -turn[2], turn[1]], [turn[2], 0, -turn[0]], [-turn[1], turn[0], 0]])
            along = [np.linalg.norm(r @ (np.array([0, 0, 1.0]) + np.cross(turn, o))) for _, o in offsets]
            return np.concatenate((r[:, 2], (r @ spin).ravel(), along))

        start = np.concatenate((position, rotation.ravel(), np.zeros(len(offsets))))
        end = solve_ivp(rates, (0.0, section.length_m), start, rtol=1e-11, atol=1e-13).y[:, -1]
        rotation = end[3:12].reshape(3, 3)
        position = end[:3] + section.rigid_m * rotation[:, 2]
        for (i, _), length in zip(offsets, end[12:], strict=True):
            shortened[i] += section.length_m - length
    return position + rotation @ np.array(geometry.tip_offset_m), shortened


def test_tip_and_tendons_are_those_of_the_integrated_backbone():
    rng = np.random.default_rng(3)
    for _ in range(2):
        bends = rng.uniform(-1.5, 1.5, 6)
        tip, shortened = travelled(UNEVEN, bends)
        np.testing.assert_allclose(forward(UNEVEN, bends).tip_m, tip, atol=1e-9)
        np.testing.assert_allclose(UNEVEN.pulls(bends), shortened, atol=1e-9)


def test_the_straight_robot_stands_along_z():
    chain = forward(UNEVEN, np.zeros(6))
    np.testing.assert_allclose(chain.tip_m, [0.001, -0.002, 0.01 + 0.1865 + 0.005 + 0.004], atol=1e-15)
    np.testing.assert_array_equal(chain.rotations, np.broadcast_to(np.eye(3), (3, 3, 3)))


def test_rotations_are_those_of_scipy():
    bends = np.array([0.7, -0.3, -1.2, 0.4, 0.2, 0.9])
    expected = np.eye(3)
    for k, found in enumerate(forward(UNEVEN, bends).rotations):
        u, v = bends[2 * k : 2 * k + 2]
        expected = expected @ Rotation.from_rotvec([-v, u, 0.0]).as_matrix()
        np.testing.assert_allclose(found, expected, atol=1e-14)


def test_bends_come_back_from_pulls_and_even_tendons_sum_to_zero():
    bends = np.random.default_rng(4).uniform(-2, 2, (50, 6))
    np.testing.assert_allclose(UNEVEN.pulls(bends) @ np.linalg.pinv(UNEVEN.pull_matrix).T, bends, atol=1e-12)
    even = TendonGeometry(tuple(even_section(0.06, 0.0045) for _ in range(3)))
    sums = even.pulls(bends).reshape(50, 3, 3).sum(axis=-1)
    np.testing.assert_allclose(sums, 0.0, atol=1e-15)


@pytest.mark.parametrize("through", [True, False])
def test_a_bend_of_section_1_pulls_far_tendons_only_without_sheaths(through):
    geometry = TendonGeometry(tuple(even_section(0.06, 0.0045) for _ in range(2)), through=through)
    pulls = geometry.pulls(np.array([1.0, 0.0, 0.0, 0.0]))
    assert pulls[0] == pytest.approx(0.0045)
    assert pulls[3] == pytest.approx(0.0045 if through else 0.0)
