"""The rod of a tendon robot against the boundary value problem of a rod cut free, solved by scipy.

The oracle is another formulation: cut at s, the backbone's own force and moment and the tendons at their arms
hold the part beyond the cut, and together they carry the weight and the load beyond,

    K kappa + sum r_i x tau_i t_i = R^T M(s),    n + sum tau_i t_i = N = F + weight beyond,    M' = -p' x N,

integrated by DOP853 from the base, with the moment at the base found by shooting; no elements, no energy.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import root

from contid.kinematics.tendon.geometry import TendonGeometry, forward
from contid.kinematics.tendon.tension import TendonStatics
from contid_tendons.rod import TendonRod
from tests.support.tendon_sections import even_section

EI, GJ, K_N_PER_M = 2945e-6, 2265e-6, 20e3
GEOMETRY = TendonGeometry(
    tuple(
        even_section(length, 0.008, first_rad=turn) for length, turn in ((0.1, 0.0), (0.08, 0.7), (0.09, 1.4))
    ),
    base_offset_m=0.01,
    tip_offset_m=(0.0, 0.002, 0.005),
)
STATICS = TendonStatics(
    GEOMETRY, tuple(EI / s.length_m for s in GEOMETRY.sections), np.full(9, K_N_PER_M), 1.0, 99.0
)
BENDS = np.array([0.5, -0.3, -0.6, 0.4, 0.2, 0.7])
FORCE = (0.05, -0.04, 0.03)


def rod(elements: int = 8, weight: float = 0.5, stretch: float = np.inf) -> TendonRod:
    return TendonRod(
        GEOMETRY, [EI] * 3, [GJ] * 3, [stretch] * 3, STATICS.tendon_n_per_m, STATICS.rest_n,
        np.tile([0.0, 0.2 * weight, -weight], (3, 1)), elements,
    )  # fmt: skip


def by_shooting(
    tensions: np.ndarray, weight: float, force: np.ndarray, stretch: float = np.inf
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Tip, its rotation and the lengths of the tendons, of a rod with these tensions."""
    down = np.array([0.0, 0.2 * weight, -weight])
    total = sum(section.length_m for section in GEOMETRY.sections)
    ends = np.cumsum([section.length_m for section in GEOMETRY.sections])
    e3 = np.array([0.0, 0.0, 1.0])
    arms = np.concatenate([np.column_stack((section.arms, np.zeros(3))) for section in GEOMETRY.sections])
    # The path of a tendon by (curvature, stretch), and what a pull along it does to both balances.
    tangents = np.stack([np.cross(np.eye(4)[:, :3], r).T + np.outer(e3, np.eye(4)[3]) for r in arms])
    squares = tangents.transpose(0, 2, 1) @ tangents
    stiff = np.diag([EI, EI, GJ, 0.0 if np.isinf(stretch) else stretch])

    def strain(moment: np.ndarray, net: np.ndarray, first: int) -> tuple[np.ndarray, float, np.ndarray]:
        """Curvature in the frame of the rod, stretch, and pace of the tendons.

        With the paces known both balances are linear in them; the paces follow by fixed point.
        """
        along, square, tau = tangents[3 * first :], squares[3 * first :], tensions[3 * first :]
        pace = np.ones(len(tau))
        for _ in range(50):
            share = tau / pace
            A = stiff + np.tensordot(share, square, 1)
            if np.isinf(stretch):
                x = np.append(np.linalg.solve(A[:3, :3], moment - A[:3, 3]), 0.0)
            else:
                x = np.linalg.solve(A, np.append(moment - A[:3, 3], net[2] - share.sum()))
            v = along @ x + e3
            last, pace = pace, np.linalg.norm(v, axis=1)
            if np.abs(pace - last).max() < 1e-12:
                break
        return x[:3], float(x[3]), pace

    def shot(base_moment: np.ndarray) -> np.ndarray:
        state = np.concatenate(
            ([0.0, 0.0, GEOMETRY.base_offset_m], np.eye(3).ravel(), base_moment, np.zeros(9))
        )
        begin = 0.0
        for first, end in enumerate(ends):

            def slope(s: float, y: np.ndarray, first: int = first) -> np.ndarray:
                R, moment = y[3:12].reshape(3, 3), y[12:15]
                net = force + down * (total - s)
                kappa, extension, pace = strain(R.T @ moment, R.T @ net, first)
                x, y_, z = kappa
                turn = np.array([[0.0, -z, y_], [z, 0.0, -x], [-y_, x, 0.0]])
                along = (1.0 + extension) * R[:, 2]
                lengths = np.zeros(9)
                lengths[3 * first :] = pace
                return np.concatenate((along, (R @ turn).ravel(), -np.cross(along, net), lengths))

            done = solve_ivp(slope, (begin, end), state, method="DOP853", rtol=1e-8, atol=1e-10)
            state, begin = done.y[:, -1], end
        return np.asarray(state)

    def left(base_moment: np.ndarray) -> np.ndarray:
        y = shot(base_moment)
        return np.asarray(y[12:15] - np.cross(y[3:12].reshape(3, 3) @ GEOMETRY.tip_offset_m, force))

    found = root(left, np.zeros(3), tol=1e-11)
    assert np.abs(found.fun).max() < 1e-9
    y = shot(found.x)
    R = y[3:12].reshape(3, 3)
    return y[:3] + R @ GEOMETRY.tip_offset_m, R, y[15:]


def test_without_loads_it_is_a_chain_of_arcs_with_the_tensions_of_the_balance() -> None:
    pulls = STATICS.pulls(BENDS)
    found = rod(3, weight=0.0).solve(pulls)
    assert found.tip_m == pytest.approx(forward(GEOMETRY, BENDS).tip_m, abs=1e-12)
    assert found.tensions_n == pytest.approx(STATICS.tensions(pulls), abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("stretch", [pytest.param(np.inf, marks=pytest.mark.campaign), 3000.0])
def test_under_weight_and_a_force_it_is_the_rod_of_the_boundary_value_problem(stretch: float) -> None:
    pulls = STATICS.pulls(BENDS)
    errors = []
    for elements in (6, 12):
        found = rod(elements, stretch=stretch).solve(pulls, FORCE)
        tip, rotation, lengths = by_shooting(found.tensions_n, 0.5, np.array(FORCE), stretch)
        errors.append(float(np.linalg.norm(found.tip_m - tip)))
        assert found.rotation == pytest.approx(rotation, abs=2e-2 / elements)
        straight = np.cumsum([section.length_m for section in GEOMETRY.sections]).repeat(3)
        stretched = np.maximum(0.0, STATICS.rest_n + K_N_PER_M * (pulls - (straight - lengths)))
        assert found.tensions_n == pytest.approx(stretched, abs=0.5 / elements**2 * 36)
    moved = np.linalg.norm(tip - forward(GEOMETRY, BENDS).tip_m)
    assert moved > 0.009
    assert errors[1] < 0.005 * moved
    assert 3.0 < errors[0] / errors[1] < 5.0


@pytest.mark.parametrize("stretch", [np.inf, 3000.0])
def test_derivatives_are_exact(stretch: float) -> None:
    arm, pulls = rod(4, stretch=stretch), STATICS.pulls(BENDS)
    here = arm.solve(pulls, FORCE)
    for k in range(9):
        step = 1e-6 * np.eye(9)[k]
        ends = [arm.solve(pulls + sign * step, FORCE, here.strain).tip_m for sign in (1, -1)]
        assert here.jacobian[:, k] == pytest.approx((ends[0] - ends[1]) / 2e-6, abs=1e-5)
    for k in range(3):
        x, y, z = (1e-5 * np.eye(3)[k]).tolist()
        fx, fy, fz = FORCE
        plus = arm.solve(pulls, (fx + x, fy + y, fz + z), here.strain).tip_m
        minus = arm.solve(pulls, (fx - x, fy - y, fz - z), here.strain).tip_m
        assert here.compliance[:, k] == pytest.approx((plus - minus) / 2e-5, abs=1e-5)
    assert here.compliance == pytest.approx(here.compliance.T, abs=1e-12)
