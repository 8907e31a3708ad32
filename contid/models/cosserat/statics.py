"""Statics of a loaded rod: Lie-group integration from base to tip, and its derivatives (the specification).

Eqs. (1)-(11) in total-wrench form: with N = n - F_P and M = m - m_P (wall and fluid together),

    N' = -f,   M' = -p' x N,   p' = R v,   R' = R hat(u),
    v = e3 (1 + strain) + diag(3/EA, 3/EA, 1/EA) R^T N,
    u = curvature + diag(1/EI, 1/EI, 3/EJ) R^T M.

Loads are dead, so N(s) is known and only the base moment has to be found. mu = M + p x N obeys
mu' = -p x f; it is what the sweep carries. A step is commutator-free and of fourth order (Celledoni,
Marthinsen, Owren 2003): exact without load, where the strains of a section are constant.

Units: mm, N, N·mm, bar. Every vector in the base frame unless its name says otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from contid.models.cosserat.section import Inflated, Rod

Array: TypeAlias = NDArray[np.float64]


def _zeros() -> Array:
    return np.zeros(3)


@dataclass(frozen=True)
class Loads:
    """Dead loads in the base frame.

    Attributes:
        tip_force, tip_moment: at the tip [N, N·mm].
        joint_force, joint_moment: at the end of section i, before its link, by i [N, N·mm].
        weight: per reference length of section i [N/mm], by i.
        link_weight: per length of link i [N/mm], by i.
    """

    tip_force: Array = field(default_factory=_zeros)
    tip_moment: Array = field(default_factory=_zeros)
    joint_force: dict[int, Array] = field(default_factory=dict)
    joint_moment: dict[int, Array] = field(default_factory=dict)
    weight: dict[int, Array] = field(default_factory=dict)
    link_weight: dict[int, Array] = field(default_factory=dict)

    def scaled(self, factor: float) -> Loads:
        """The same loads times a factor, for continuation."""

        def times(table: dict[int, Array]) -> dict[int, Array]:
            return {i: factor * value for i, value in table.items()}

        return Loads(
            factor * self.tip_force,
            factor * self.tip_moment,
            times(self.joint_force),
            times(self.joint_moment),
            times(self.weight),
            times(self.link_weight),
        )

    def base_force(self, rod: Rod) -> Array:
        """N at the base: everything the rod carries."""
        total = self.tip_force.copy()
        for i, section in enumerate(rod.sections):
            total += self.joint_force.get(i, 0.0)
            total += section.length * self.weight.get(i, _zeros())
            total += section.link * self.link_weight.get(i, _zeros())
        return total

    @property
    def none(self) -> bool:
        """True when nothing acts on the rod."""
        tables = (self.joint_force, self.joint_moment, self.weight, self.link_weight)
        vectors = (self.tip_force, self.tip_moment, *(v for table in tables for v in table.values()))
        return not any(np.any(vector) for vector in vectors)


@dataclass(frozen=True, slots=True)
class Tangents:
    """Derivatives by (base moment, pressures): columns 0..2 and 3.. of every array, shape (3, 3 + 3k).

    Attributes:
        moment: of the moment residual at the tip.
        tip: of the tip position.
        turn: rotation vector of the tip frame, in the base frame.
        ends: of the end of every section.
    """

    moment: Array
    tip: Array
    turn: Array
    ends: tuple[Array, ...]


@dataclass(frozen=True, slots=True)
class Sweep:
    """One integration from base to tip.

    Attributes:
        tip: tip position. rotation: tip frame, shape (3, 3). ends: end of every section.
        moment: residual of the moment balance at the tip [N·mm]; zero in equilibrium.
        points: backbone at every element boundary and link end, shape (n, 3), base included.
        stations: reference length at the points.
        turns: turn of the frame by the base moment at every element boundary, base included, shape (3, 3)
            each; empty without tangents.
        tangents: derivatives when they were asked for.
    """

    tip: Array
    rotation: Array
    ends: tuple[Array, ...]
    moment: Array
    points: Array
    stations: Array
    turns: tuple[Array, ...]
    tangents: Tangents | None


def hat(a: Array) -> Array:
    """The matrix of ``a x``."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def cross(a: Array, b: Array) -> Array:
    """Cross product of two vectors; several times faster than `numpy.cross` for one pair."""
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]],
    )


def exponential(u: Array, v: Array) -> tuple[Array, Array]:
    """Rotation and shift of the screw motion ``exp(u, v)``: rotation vector u, translation part v.

    ``R = I + a hat(u) + b hat(u)^2``, ``shift = (I + b hat(u) + c hat(u)^2) v`` with a = sin t / t,
    b = (1 - cos t) / t^2, c = (t - sin t) / t^3, by their series below t = 0.05, where the quotients lose
    digits (the remainder is then below 1e-17).
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
    return eye + a * k + b * kk, (eye + b * k + c * kk) @ v


@dataclass(slots=True)
class State:
    """Frame R, position p and mu at one station, with derivatives (turn, shift, dmu) by column."""

    R: Array
    p: Array
    mu: Array
    turn: Array
    shift: Array
    dmu: Array


def strains(inflated: Inflated, R: Array, N: Array, M: Array) -> tuple[Array, Array]:
    """Strains u, v in the body frame under the total force N and moment M (eq. 4 in total-wrench form)."""
    m, n = R.T @ M, R.T @ N
    u = inflated.curvature + np.array([inflated.bend * m[0], inflated.bend * m[1], inflated.twist * m[2]])
    v = np.array(
        [inflated.shear * n[0], inflated.shear * n[1], 1.0 + inflated.strain + inflated.axial * n[2]],
    )
    return u, v


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
    inflated: Inflated, state: State, u: Array, v: Array, N: Array, M: Array, f: Array, own: slice | None
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
    inflated: Inflated, start: State, N: Array, f: Array, h: float, own: slice | None, tangents: bool
) -> State:
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
            R, shift = exponential(du, dv)
            stage = State(
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
    R1, d1 = exponential(
        k * (3.0 * us[0] + 2.0 * us[1] + 2.0 * us[2] - us[3]),
        k * (3.0 * vs[0] + 2.0 * vs[1] + 2.0 * vs[2] - vs[3]),
    )
    R2, d2 = exponential(
        k * (-us[0] + 2.0 * us[1] + 2.0 * us[2] + 3.0 * us[3]),
        k * (-vs[0] + 2.0 * vs[1] + 2.0 * vs[2] + 3.0 * vs[3]),
    )
    middle = start.R @ R1
    end = State(
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


def sweep(
    rod: Rod,
    pressures: Array,
    base_moment: Array,
    loads: Loads,
    elements: int = 3,
    tangents: bool = False,
) -> Sweep:
    """Integrate from the clamped base to the tip.

    Args:
        rod: the sections.
        pressures: [bar], shape (3k,).
        base_moment: total moment M at the base [N·mm], shape (3,).
        loads: dead loads.
        elements: steps per section.
        tangents: also integrate the variational equations, one column per unknown. They are the derivative
            of the continuous flow by the same scheme, so they differ from the derivative of the discrete map
            by the discretisation error; Newton then converges linearly with a factor of 1e-2 or less.
    """
    columns = 3 + rod.pressures
    dmu = np.zeros((3, columns))
    dmu[:, :3] = np.eye(3)
    state = State(
        np.eye(3),
        np.zeros(3),
        np.array(base_moment, float),
        np.zeros((3, columns)),
        np.zeros((3, columns)),
        dmu,
    )
    N = loads.base_force(rod)
    points, stations, turns = [state.p], [0.0], [state.turn[:, :3]]
    ends: list[Array] = []
    end_tangents: list[Array] = []
    for i, section in enumerate(rod.sections):
        inflated = section.inflated(pressures[3 * i : 3 * i + 3])
        f = loads.weight.get(i, _zeros())
        h = section.length / elements
        own = slice(3 + 3 * i, 6 + 3 * i)
        for _ in range(elements):
            state = step(inflated, state, N, f, h, own, tangents)
            N = N - h * f
            points.append(state.p)
            stations.append(stations[-1] + h)
            turns.append(state.turn[:, :3])
        ends.append(state.p)
        end_tangents.append(state.shift)
        if i in loads.joint_force or i in loads.joint_moment:
            force = loads.joint_force.get(i, _zeros())
            state.mu = state.mu - loads.joint_moment.get(i, _zeros()) - cross(state.p, force)
            state.dmu = state.dmu + hat(force) @ state.shift
            N = N - force
        if section.link > 0.0:
            state = link(state, section.link, loads.link_weight.get(i, _zeros()))
            N = N - section.link * loads.link_weight.get(i, _zeros())
            points.append(state.p)
            stations.append(stations[-1] + section.link)
    moment = state.mu - cross(state.p, loads.tip_force) - loads.tip_moment
    derived = None
    if tangents:
        derived = Tangents(
            state.dmu + hat(loads.tip_force) @ state.shift, state.shift, state.turn, tuple(end_tangents)
        )
    return Sweep(
        state.p,
        state.R,
        tuple(ends),
        moment,
        np.array(points),
        np.array(stations),
        tuple(turns) if tangents else (),
        derived,
    )


def link(state: State, length: float, f: Array) -> State:
    """A rigid link of constant weight per length: p' = R e3 (eq. 6, erratum: R' = 0)."""
    e = state.R[:, 2]
    centre = state.p + 0.5 * length * e
    centre_shift = state.shift - 0.5 * length * hat(e) @ state.turn
    return State(
        state.R,
        state.p + length * e,
        state.mu - length * cross(centre, f),
        state.turn,
        state.shift - length * hat(e) @ state.turn,
        state.dmu + length * hat(f) @ centre_shift,
    )
