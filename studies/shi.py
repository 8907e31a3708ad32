"""Shi et al.'s own formulation, literally: wall force and moment by RK4, everything in one least squares.

Eqs. (1)-(11) with the errata of docs/robots/stiffflop.md: the state is (p, R, n, m), the six chambers push
through ``f_P`` and ``l_P`` (eq. 3, where ``m_P`` on the left reads l_P), and the rotation is a matrix that
RK4 does not keep orthogonal. `inverse` is eqs. (14)-(17): base force, base moment and pressures are all
unknowns of one trust-region-reflective least squares with finite differences.

It is a baseline for speed and, with more elements, a plant that shares no integrator with contid's model.
Functions are vectorised over the first axis of every array.

Units: mm, N, N·mm, bar.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.section import NEWTON_PER_BAR_MM2, Rod, Section

#: Elements per segment of the paper.
PAPER_ELEMENTS = 6
#: "The sum of squared residual errors less than 1e-6", read in mm, N and N·mm (erratum 6).
PAPER_SSE = 1e-6


@dataclass(frozen=True, slots=True)
class Ends:
    """Where the integration ended, shape (B, ..): tip, frame, end of the first segment, wall residuals."""

    tip: Array
    rotation: Array
    mid: Array
    force_error: Array
    moment_error: Array


def _cross(a: Array, b: Array) -> Array:
    return np.stack(
        [
            a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1],
            a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2],
            a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0],
        ],
        axis=1,
    )


class _Wall:
    """One segment at given pressures: stiffnesses and chamber loads, shape (B, ..)."""

    def __init__(self, section: Section, pressures: Array) -> None:
        modulus = np.array([section.modulus(float(x))[0] for x in pressures.mean(axis=1)])
        G = modulus / 3.0
        self.K_se = np.stack([G, G, modulus], axis=1) * section.area
        bend = modulus * section.inertia
        self.K_bt = np.stack([bend, bend, G * section.torsion], axis=1)
        #: Sum of P A_c over the six chambers, and of d x (P A_c e3), in the body frame.
        self.push = 2.0 * section.chamber_area * NEWTON_PER_BAR_MM2 * pressures.sum(axis=1)
        self.turn = pressures @ section.pair_moment.T

    def tip_wrench(self, R: Array) -> tuple[Array, Array]:
        """F_P and m_P of eq. (9)."""
        return self.push[:, None] * R[:, :, 2], np.einsum("bij,bj->bi", R, self.turn)

    def rates(self, R: Array, n: Array, m: Array) -> tuple[Array, Array, Array, Array]:
        """p', R', n', m' of eqs. (1)-(4)."""
        v = np.einsum("bji,bj->bi", R, n) / self.K_se
        v[:, 2] += 1.0
        u = np.einsum("bji,bj->bi", R, m) / self.K_bt
        p_s = np.einsum("bij,bj->bi", R, v)
        hat_u = np.zeros((len(u), 3, 3))
        hat_u[:, 0, 1], hat_u[:, 0, 2], hat_u[:, 1, 2] = -u[:, 2], u[:, 1], -u[:, 0]
        hat_u[:, 1, 0], hat_u[:, 2, 0], hat_u[:, 2, 1] = u[:, 2], -u[:, 1], u[:, 0]
        R_s = R @ hat_u
        n_s = self.push[:, None] * R_s[:, :, 2]
        # (v + hat(u) d) x e3 + hat(d) hat(u) e3 = v x e3 + u x (d x e3) by Jacobi's identity.
        side = np.stack([v[:, 1], -v[:, 0], np.zeros(len(v))], axis=1) * self.push[:, None]
        l_P = np.einsum("bij,bj->bi", R, side + _cross(u, self.turn))
        return p_s, R_s, n_s, l_P - _cross(p_s, n)


def integrate(rod: Rod, pressures: Array, n0: Array, m0: Array, force: Array, elements: int) -> Ends:
    """Base to tip by classical RK4.

    Args:
        rod: the segments.
        pressures: [bar], shape (B, 3k).
        n0: wall force at the base, shape (B, 3).
        m0: wall moment at the base, shape (B, 3).
        force: on the tip, shape (3,).
        elements: steps per segment.
    """
    count = len(pressures)
    p, R, n, m = np.zeros((count, 3)), np.tile(np.eye(3), (count, 1, 1)), n0, m0
    mid = p
    for i, section in enumerate(rod.sections):
        wall = _Wall(section, pressures[:, 3 * i : 3 * i + 3])
        if i > 0:
            F_P, m_P = wall.tip_wrench(R)
            n, m = n + F_P, m + m_P
        h = section.length / elements
        for _ in range(elements):
            p1, R1, n1, m1 = wall.rates(R, n, m)
            p2, R2, n2, m2 = wall.rates(R + 0.5 * h * R1, n + 0.5 * h * n1, m + 0.5 * h * m1)
            p3, R3, n3, m3 = wall.rates(R + 0.5 * h * R2, n + 0.5 * h * n2, m + 0.5 * h * m2)
            p4, R4, n4, m4 = wall.rates(R + h * R3, n + h * n3, m + h * m3)
            w = h / 6.0
            p = p + w * (p1 + 2.0 * p2 + 2.0 * p3 + p4)
            R = R + w * (R1 + 2.0 * R2 + 2.0 * R3 + R4)
            n = n + w * (n1 + 2.0 * n2 + 2.0 * n3 + n4)
            m = m + w * (m1 + 2.0 * m2 + 2.0 * m3 + m4)
        if i == 0:
            mid = p
        F_P, m_P = wall.tip_wrench(R)
        n, m = n - F_P, m - m_P
        if section.link > 0.0:
            m = m - section.link * _cross(R[:, :, 2], n)
            p = p + section.link * R[:, :, 2]
    return Ends(p, R, mid, n - force, m)


def _base(rod: Rod, pressures: Array, force: Array, moment: Array) -> tuple[Array, Array]:
    """Wall force and moment at the base that belong to a total base moment; the total force is the tip's."""
    F_P, m_P = _Wall(rod.sections[0], pressures[:, :3]).tip_wrench(np.tile(np.eye(3), (len(pressures), 1, 1)))
    return F_P + force, m_P + moment


def forward(rod: Rod, pressures: Array, force: Array, elements: int) -> Ends:
    """Equilibrium of many cases by Newton's method with finite differences, the load raised in steps.

    Raises:
        ArithmeticError: some case did not converge.
    """
    count = len(pressures)
    moment = np.zeros((count, 3))
    tiled = np.tile(pressures, (4, 1))
    delta = 1e-6
    ends = integrate(rod, pressures, *_base(rod, pressures, 0.0 * force, moment), 0.0 * force, elements)
    steps = 6 if np.any(force) else 1
    for k in range(1, steps + 1):
        load = force * k / steps
        for _ in range(12):
            trial = np.tile(moment, (4, 1))
            for column in range(3):
                trial[(column + 1) * count : (column + 2) * count, column] += delta
            ends = integrate(rod, tiled, *_base(rod, tiled, load, trial), load, elements)
            error = ends.moment_error[:count]
            if float(np.abs(error).max()) < 1e-9:
                break
            by_moment = np.stack(
                [(ends.moment_error[(c + 1) * count : (c + 2) * count] - error) / delta for c in range(3)],
                axis=2,
            )
            moment = moment - np.linalg.solve(by_moment, error[:, :, None])[:, :, 0]
        else:
            raise ArithmeticError("the plant found no equilibrium")
    return Ends(
        *(getattr(ends, name)[:count] for name in ("tip", "rotation", "mid", "force_error", "moment_error"))
    )


class _MetError(Exception):
    """Ends scipy's solver when the paper's stopping rule holds; scipy has no rule for the residual."""

    def __init__(self, unknown: Array) -> None:
        self.unknown = unknown


def inverse(
    rod: Rod,
    start: Array,
    force: Array,
    tip: Array,
    mid: Array | None = None,
    frame: Array | None = None,
    upper_bar: float = 1.5,
    by_the_paper: bool = True,
) -> tuple[Array, bool]:
    """One solve of eqs. (15)-(17) from the last unknowns; returns the new ones and whether the task is met.

    Args:
        rod: the segments.
        start: unknowns of the point before, shape (6 + 3k,).
        force: on the tip [N].
        tip: target of the tip [mm].
        mid: target of the end of the first segment [mm], eq. (16).
        frame: target of the tip frame, eq. (17).
        upper_bar: greatest pressure.
        by_the_paper: stop at the paper's sum of squares instead of scipy's own relative tolerances of 1e-8.
    """
    from scipy.optimize import least_squares

    def residual(unknown: Array) -> Array:
        ends = integrate(rod, unknown[None, 6:], unknown[None, :3], unknown[None, 3:6], force, PAPER_ELEMENTS)
        rows = [ends.force_error[0], ends.moment_error[0], ends.tip[0] - tip]
        if mid is not None:
            rows.append(ends.mid[0] - mid)
        if frame is not None:
            difference = ends.rotation[0].T @ frame
            skew = difference - difference.T
            rows.append(np.array([skew[2, 1], skew[0, 2], skew[1, 0]]))
        r: Array = np.concatenate(rows)
        if by_the_paper and float(r @ r) < PAPER_SSE:
            raise _MetError(unknown.copy())
        return r

    low = np.concatenate([np.full(6, -np.inf), np.zeros(rod.pressures)])
    high = np.concatenate([np.full(6, np.inf), np.full(rod.pressures, upper_bar)])
    try:
        found = least_squares(
            residual, np.clip(start, low, high), bounds=(low, high), method="trf", max_nfev=100
        )
    except _MetError as met:
        return met.unknown, True
    return np.asarray(found.x), bool(2.0 * found.cost < PAPER_SSE)


def unknowns(rod: Rod, pressures: Array, force: Array, moment: Array) -> Array:
    """The vector (n0, m0, P) of a known solution, to start a run from."""
    n0, m0 = _base(rod, pressures[None], force, moment[None])
    return np.concatenate([n0[0], m0[0], pressures])
