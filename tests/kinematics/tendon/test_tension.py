"""Balance of tendons and backbone against minimised energy and linear programmes of scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog, minimize

from contid.kinematics.tendon.geometry import TendonGeometry, TendonSection
from contid.kinematics.tendon.tension import TendonStatics, balanced
from tests.support.tendon_sections import even_section

FLOOR_N, LIMIT_N = 1.0, 25.0


def statics(through: bool = True) -> TendonStatics:
    geometry = TendonGeometry(
        (
            TendonSection(0.10, (0.008, 0.0085, 0.008), (0.0, 2.2, 4.1)),
            even_section(0.09, 0.008, 4, 0.7),
            even_section(0.08, 0.007, 3, 1.4),
        ),
        through,
    )
    stiffness = np.repeat((20e3, 15e3, 12e3), (3, 4, 3))
    return TendonStatics(geometry, (0.03, 0.033, 0.036), stiffness, FLOOR_N, LIMIT_N)


@pytest.mark.parametrize("through", [True, False])
def test_pulls_lead_to_the_bends_of_least_energy(through):
    """Elastic energy of tendons and backbone, minimised by scipy, without the closed form."""
    body = statics(through)
    stiffness = body.tendon_n_per_m
    bending = np.repeat(body.bending_nm, 2)

    def energy(bends, pulls):
        stretch = body.rest_n / stiffness + pulls - body.geometry.pulls(bends)
        return 0.5 * float(stiffness @ stretch**2) + 0.5 * float(bending @ bends**2)

    rng = np.random.default_rng(1)
    for _ in range(5):
        pulls = rng.uniform(-0.01, 0.01, body.geometry.tendons)
        found = minimize(energy, np.zeros(6), args=(pulls,), method="BFGS", options={"gtol": 1e-9})
        np.testing.assert_allclose(body.bends(pulls), found.x, atol=2e-5)


@pytest.mark.parametrize("through", [True, False])
def test_forward_undoes_inverse_and_tensions_are_what_the_stretch_gives(through):
    body = statics(through)
    for bends in np.random.default_rng(2).uniform(-1.5, 1.5, (100, 6)):
        pulls = body.pulls(bends)
        np.testing.assert_allclose(body.bends(pulls), bends, atol=1e-12)
        tensions = body.tensions(pulls)
        np.testing.assert_allclose(tensions, body.tensions_of_bends(bends), atol=1e-9)
        for rows in body.geometry.tendon_slices:
            assert np.min(tensions[rows]) == pytest.approx(FLOOR_N, abs=1e-9)
        moments = body.geometry.pull_matrix.T @ tensions
        np.testing.assert_allclose(moments, np.repeat(body.bending_nm, 2) * bends, atol=1e-12)


def test_no_smaller_tensions_hold_three_tendons():
    """A linear programme: least sum of tensions with the moments of the bends, each at or above the floor."""
    geometry = TendonGeometry(tuple(even_section(0.1, 0.008, 3, 0.6 * s) for s in range(3)))
    body = TendonStatics(geometry, (0.03,) * 3, np.full(9, 20e3), FLOOR_N, LIMIT_N)
    for bends in np.random.default_rng(3).uniform(-1.5, 1.5, (20, 6)):
        best = linprog(
            np.ones(9),
            A_eq=geometry.pull_matrix.T,
            b_eq=0.03 * bends,
            bounds=[(FLOOR_N, None)] * 9,
        )
        np.testing.assert_allclose(body.tensions_of_bends(bends), best.x, atol=1e-6)


def test_the_pieces_are_the_tensions():
    body = statics()
    pieces = body.pieces()
    for bends in np.random.default_rng(4).uniform(-1.5, 1.5, (20, 6)):
        most = np.full(body.geometry.tendons, -np.inf)
        for tendon, row, offset in pieces:
            most[tendon] = max(most[tendon], float(row @ bends) + offset)
        np.testing.assert_allclose(most, body.tensions_of_bends(bends), atol=1e-10)


def test_tendons_on_one_side_do_not_balance():
    assert balanced(TendonSection(0.1, (0.008,) * 3, (0.0, 1.0, 2.0)).arms) is None
    even = balanced(even_section(0.1, 0.008, 5).arms)
    assert even is not None
    np.testing.assert_allclose(even, 1.0, atol=1e-12)
