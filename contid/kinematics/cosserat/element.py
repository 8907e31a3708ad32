"""One element of a loaded rod: Lie-group integration of its frame, its wrench and their derivatives.

A step is commutator-free and of fourth order (Celledoni, Marthinsen, Owren 2003); without load, where strains
are constant, it is exact. The equations are in `compliance`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.section import Inflated


def hat(a: Array) -> Array:
    """The matrix of ``a x``, shape (3, 3)."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def cross(a: Array, b: Array) -> Array:
    """Cross product of two vectors, shape (3,); several times faster than `numpy.cross` for one pair."""
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]],
    )


class RigidMotion(NamedTuple):
    """A motion ``x -> R x + p``.

    Attributes:
        R: rotation matrix, shape (3, 3).
        p: shift, shape (3,), in the unit of lengths.
    """

    R: Array
    p: Array


def exp_se3(u: Array, v: Array) -> RigidMotion:
    """Exponential of a twist: the motion of a frame with constant strains over a length of 1.

    K. M. Lynch, F. C. Park: "Modern Robotics", Cambridge University Press 2017, sections 3.2.3 and 3.3.3:
    ``R = I + a hat(u) + b hat(u)^2``, ``shift = (I + b hat(u) + c hat(u)^2) v`` with a = sin t / t,
    b = (1 - cos t) / t^2, c = (t - sin t) / t^3, by their series below t = 0.05, where the quotients lose
    digits (the remainder is then below 1e-17).

    Args:
        u: rotation vector [rad], shape (3,).
        v: translation part, in the unit of lengths, shape (3,); both in the frame that moves.
    """
    t2 = float(u @ u)
    if t2 < 2.5e-3:
        a = 1.0 - t2 / 6.0 * (1.0 - t2 / 20.0 * (1.0 - t2 / 42.0 * (1.0 - t2 / 72.0)))
        b = 0.5 * (1.0 - t2 / 12.0 * (1.0 - t2 / 30.0 * (1.0 - t2 / 56.0 * (1.0 - t2 / 90.0))))
        c = (1.0 - t2 / 20.0 * (1.0 - t2 / 42.0 * (1.0 - t2 / 72.0 * (1.0 - t2 / 110.0)))) / 6.0
    else:
        t = float(np.sqrt(t2))
        a = float(np.sin(t)) / t
        b = (1.0 - float(np.cos(t))) / t2
        c = (1.0 - a) / t2
    k = hat(u)
    kk = k @ k
    eye = np.eye(3)
    return RigidMotion(eye + a * k + b * kk, (eye + b * k + c * kk) @ v)


@dataclass(slots=True)
class RodState:
    """Frame R, position p and mu at one station, with derivatives (turn, shift, dmu) by column."""

    R: Array
    p: Array
    mu: Array
    turn: Array
    shift: Array
    dmu: Array


class Strains(NamedTuple):
    """Strains of a cross-section in the body frame: u, bends and twist [1/mm]; v, shears and stretch."""

    u: Array
    v: Array


def strains(inflated: Inflated, R: Array, N: Array, M: Array) -> Strains:
    """Strains under the total force N [N] and moment M [N·mm] in the base frame (eq. 4, total wrench)."""
    m, n = R.T @ M, R.T @ N
    u = inflated.curvature + np.array([inflated.bend * m[0], inflated.bend * m[1], inflated.twist * m[2]])
    v = np.array(
        [inflated.shear * n[0], inflated.shear * n[1], 1.0 + inflated.strain + inflated.axial * n[2]],
    )
    return Strains(u, v)


def turn_rate(inflated: Inflated, e: Array, wrench: Array) -> Array:
    """``R diag(1/EI, 1/EI, 3/EJ) R^T`` times the columns of ``wrench``; e is the tangent of the section."""
    rate: Array = inflated.bend * wrench + (inflated.twist - inflated.bend) * np.outer(e, e @ wrench)
    return rate


def shift_rate(inflated: Inflated, e: Array, V: Array, N: Array, turn: Array) -> Array:
    """Derivative of p' = R v under the rotation columns ``turn``: ``turn x V - R K R^T (turn x N)``."""
    x = -hat(N) @ turn
    rate: Array = -hat(V) @ turn - inflated.shear * x - (inflated.axial - inflated.shear) * np.outer(e, e @ x)
    return rate


def _tangent_rates(
    inflated: Inflated, state: RodState, u: Array, v: Array, N: Array, M: Array, f: Array, own: slice | None
) -> tuple[Array, Array, Array]:
    """Rates of (turn, shift, dmu); ``own`` are the columns of this section's pressures, if any."""
    e = state.R[:, 2]
    V = state.R @ v
    wrench = state.dmu + hat(N) @ state.shift + hat(M) @ state.turn
    turn = turn_rate(inflated, e, wrench)
    shift = shift_rate(inflated, e, V, N, state.turn)
    if own is not None:
        # u and v - e3 are both proportional to 1/E, so the modulus acts on them as one factor.
        softening = inflated.softening
        turn[:, own] += state.R @ (inflated.curvature_per_bar + softening * u[:, None])
        shift[:, own] += (inflated.strain_per_bar * e + softening * (V - e))[:, None]
    return turn, shift, hat(f) @ state.shift


def step(
    inflated: Inflated, start: RodState, N: Array, f: Array, h: float, own: slice | None, tangents: bool
) -> RodState:
    """One element of reference length h; N is the force at its start."""
    rates: list[tuple[Array, Array, Array]] = []
    us: list[Array] = []
    vs: list[Array] = []
    mus: list[Array] = []
    stage = start
    half_frame: tuple[Array, Array] | None = None
    for index, c in enumerate((0.0, 0.5, 0.5, 1.0)):
        if index:
            if index == 3:
                # g4 = g2 exp(k3 - k1/2): what makes the scheme free of commutators.
                assert half_frame is not None
                base_R, base_p = half_frame
                du, dv = h * (us[2] - 0.5 * us[0]), h * (vs[2] - 0.5 * vs[0])
            else:
                base_R, base_p = start.R, start.p
                du, dv = 0.5 * h * us[-1], 0.5 * h * vs[-1]
            R, shift = exp_se3(du, dv)
            stage = RodState(
                base_R @ R,
                base_p + base_R @ shift,
                start.mu + c * h * mus[-1],
                start.turn,
                start.shift,
                start.dmu,
            )
            if index == 1:
                half_frame = (stage.R, stage.p)
            if tangents:
                stage.turn = start.turn + c * h * rates[-1][0]
                stage.shift = start.shift + c * h * rates[-1][1]
                stage.dmu = start.dmu + c * h * rates[-1][2]
        force = N - c * h * f
        M = stage.mu - cross(stage.p, force)
        u, v = strains(inflated, stage.R, force, M)
        us.append(u)
        vs.append(v)
        mus.append(-cross(stage.p, f))
        if tangents:
            rates.append(_tangent_rates(inflated, stage, u, v, force, M, f, own))
    k = h / 12.0
    R1, d1 = exp_se3(
        k * (3.0 * us[0] + 2.0 * us[1] + 2.0 * us[2] - us[3]),
        k * (3.0 * vs[0] + 2.0 * vs[1] + 2.0 * vs[2] - vs[3]),
    )
    R2, d2 = exp_se3(
        k * (-us[0] + 2.0 * us[1] + 2.0 * us[2] + 3.0 * us[3]),
        k * (-vs[0] + 2.0 * vs[1] + 2.0 * vs[2] + 3.0 * vs[3]),
    )
    middle = start.R @ R1
    end = RodState(
        middle @ R2,
        start.p + start.R @ d1 + middle @ d2,
        start.mu + h / 6.0 * (mus[0] + 2.0 * mus[1] + 2.0 * mus[2] + mus[3]),
        start.turn,
        start.shift,
        start.dmu,
    )
    if tangents:
        end.turn, end.shift, end.dmu = (
            old + h / 6.0 * (rates[0][i] + 2.0 * rates[1][i] + 2.0 * rates[2][i] + rates[3][i])
            for i, old in enumerate((start.turn, start.shift, start.dmu))
        )
    return end


def link(state: RodState, length: float, f: Array) -> RodState:
    """A rigid link of constant weight per length: p' = R e3 (eq. 6, erratum: R' = 0)."""
    e = state.R[:, 2]
    centre = state.p + 0.5 * length * e
    centre_shift = state.shift - 0.5 * length * hat(e) @ state.turn
    return RodState(
        state.R,
        state.p + length * e,
        state.mu - length * cross(centre, f),
        state.turn,
        state.shift - length * hat(e) @ state.turn,
        state.dmu + length * hat(f) @ centre_shift,
    )
