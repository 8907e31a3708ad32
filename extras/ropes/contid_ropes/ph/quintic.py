"""A spatial Pythagorean-hodograph quintic: a polynomial curve whose arc length is a polynomial too.

With the preimage ``A(t) = A0 (1-t)^2 + 2 A1 t (1-t) + A2 t^2`` the hodograph is ``r'(t) = A i A*`` and the
parametric speed ``sigma = |A|^2``: length, curvature and frames need no square root under an integral.

Source: Singh et al., IROS 2018, Eqs. 2-14; Farouki, Pythagorean-hodograph curves (2008). Eqs. 12 and 13 are
printed correctly; Eq. 14 lacks the norm (as printed it is ``P5 - P0``): the length is the mean of the five
Bernstein coefficients of sigma.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from contid.kinematics.array import Array
from contid_ropes.ph.lift import product

# The energies' integrands are rational. 24 points give a 270 degree arc to 1e-15; 12 would leave 1e-9.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)
GAUSS_T: Array = 0.5 * (_NODES + 1.0)
GAUSS_WEIGHT: Array = 0.5 * _WEIGHTS


def bernstein(coefficients: Array, t: Array) -> Array:
    """Value of a Bernstein polynomial by de Casteljau's rule, which never leaves the coefficients' hull.

    Args:
        coefficients: shape ``(degree + 1, ...)``.
        t: parameters, shape ``(n,)``.

    Returns:
        Shape ``(n, ...)``.
    """
    weight = t.reshape((-1,) + (1,) * (coefficients.ndim - 1))
    level = [np.broadcast_to(c, (len(t), *c.shape)) for c in coefficients]
    while len(level) > 1:
        level = [a + (b - a) * weight for a, b in pairwise(level)]
    return np.array(level[0])


@dataclass(frozen=True, eq=False)
class PhQuintic:
    """One quintic.

    Attributes:
        start_m: first point [m], shape ``(3,)``.
        preimage: A0, A1, A2 [sqrt(m)], shape ``(3, 4)``.
    """

    start_m: Array
    preimage: Array

    @cached_property
    def control_points_m(self) -> Array:
        """Bezier points P0..P5 [m], shape ``(6, 3)`` (Eqs. 12, 13)."""
        a0, a1, a2 = self.preimage
        steps = [
            product(a0, a0) / 5.0,
            product(a0, a1) / 5.0,
            (product(a0, a2) + 2.0 * product(a1, a1)) / 15.0,
            product(a1, a2) / 5.0,
            product(a2, a2) / 5.0,
        ]
        return self.start_m + np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])

    @cached_property
    def speed_coefficients(self) -> Array:
        """Bernstein coefficients of the parametric speed [m], shape ``(5,)``."""
        a0, a1, a2 = self.preimage
        return np.array([a0 @ a0, a0 @ a1, (a0 @ a2 + 2.0 * (a1 @ a1)) / 3.0, a1 @ a2, a2 @ a2])

    @cached_property
    def length_m(self) -> float:
        """Arc length in closed form [m]: the mean of the speed's coefficients (Eq. 14 with its norm)."""
        return float(self.speed_coefficients.sum()) / 5.0

    @cached_property
    def _arc_coefficients(self) -> Array:
        return np.concatenate([[0.0], np.cumsum(self.speed_coefficients) / 5.0])

    def spinor(self, t: Array) -> tuple[Array, Array]:
        """``A(t)`` and ``A'(t)``, each of shape ``(n, 4)``."""
        a0, a1, a2 = self.preimage
        w = np.asarray(t, dtype=np.float64).reshape(-1, 1)
        left, right = a0 + (a1 - a0) * w, a1 + (a2 - a1) * w
        return left + (right - left) * w, 2.0 * (right - left)

    def point(self, t: Array) -> Array:
        """Points [m] at parameters ``t``, shape ``(n, 3)``."""
        return bernstein(self.control_points_m, np.asarray(t, dtype=np.float64).reshape(-1))

    def tangent(self, t: Array) -> Array:
        """Unit tangents, shape ``(n, 3)``."""
        a, _ = self.spinor(t)
        unit: Array = product(a, a) / np.sum(a * a, axis=-1, keepdims=True)
        return unit

    def speed(self, t: Array) -> Array:
        """Parametric speed sigma [m], shape ``(n,)``; never negative."""
        a, _ = self.spinor(t)
        sigma: Array = np.sum(a * a, axis=-1)
        return sigma

    def arc_length(self, t: Array) -> Array:
        """Length from the start to ``t`` [m], a polynomial of degree five, shape ``(n,)``."""
        return bernstein(self._arc_coefficients, np.asarray(t, dtype=np.float64).reshape(-1))

    def parameter_at(self, s_m: Array) -> Array:
        """Inverse of `arc_length` by Newton inside a shrinking bracket (arc length is monotone)."""
        s = np.clip(np.asarray(s_m, dtype=np.float64).reshape(-1), 0.0, self.length_m)
        low, high = np.zeros_like(s), np.ones_like(s)
        t = s / self.length_m
        for _ in range(60):
            excess = self.arc_length(t) - s
            low, high = np.where(excess < 0.0, t, low), np.where(excess > 0.0, t, high)
            speed = self.speed(t)
            step = t - excess / np.where(speed > 0.0, speed, np.inf)
            inside = (step >= low) & (step <= high) & (speed > 0.0)
            new = np.where(excess == 0.0, t, np.where(inside, step, 0.5 * (low + high)))
            if np.max(np.abs(new - t), initial=0.0) <= 1e-15:
                return new
            t = new
        return t

    def rates(self, t: Array) -> tuple[Array, Array, Array]:
        """Angular rates of the Euler-Rodrigues frame per unit of ``t``: spin w1, bending k2 and k3.

        ``f2' . f3 = w1``, ``t' . f2 = k2``, ``t' . f3 = k3``; the curvature is ``hypot(k2, k3) / sigma``.
        """
        a, d = self.spinor(t)
        u, v, p, q = a.T
        du, dv, dp, dq = d.T
        sigma = np.sum(a * a, axis=-1)
        spin = 2.0 * (u * dv - du * v - p * dq + dp * q) / sigma
        bend2 = 2.0 * (u * dq - du * q - v * dp + dv * p) / sigma
        bend3 = -2.0 * (u * dp - du * p + v * dq - dv * q) / sigma
        return spin, bend2, bend3

    @cached_property
    def bending_energy(self) -> float:
        """``integral of curvature^2 ds`` [1/m] for unit stiffness."""
        _, k2, k3 = self.rates(GAUSS_T)
        return float(GAUSS_WEIGHT @ ((k2 * k2 + k3 * k3) / self.speed(GAUSS_T)))

    @cached_property
    def twist_energy(self) -> float:
        """``integral of (spin of the Euler-Rodrigues frame)^2 ds`` [1/m].

        The paper minimises "bending and twisting energy" without naming a frame; this is the frame its
        polynomials define.
        """
        spin, _, _ = self.rates(GAUSS_T)
        return float(GAUSS_WEIGHT @ (spin * spin / self.speed(GAUSS_T)))

    def evenly(self, points: int) -> Array:
        """Points at equal arc length from start to end [m], shape ``(points, 3)``."""
        return self.point(self.parameter_at(np.linspace(0.0, self.length_m, points)))


def points_at(pieces: Sequence[PhQuintic], s_m: Array) -> Array:
    """Points [m] at arc lengths from the start of the first piece, shape ``(n, 3)``.

    Each piece starts at the end of the one before. An arc length before the start or beyond the end gives
    that end.
    """
    starts = np.concatenate([[0.0], np.cumsum([piece.length_m for piece in pieces])[:-1]])
    piece_of = np.clip(np.searchsorted(starts, s_m, side="right") - 1, 0, len(pieces) - 1)
    points = np.empty((len(s_m), 3))
    for index, piece in enumerate(pieces):
        inside = piece_of == index
        points[inside] = piece.point(piece.parameter_at(s_m[inside] - starts[index]))
    return points
