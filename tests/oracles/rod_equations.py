"""The differential equations of a loaded rod, integrated by DOP853 on positions, matrices and wrenches.

    p' = R v,  R' = R hat(u),  N' = -f,  M' = -p' x N

from a base moment, with every kind of load; a base moment belongs to an equilibrium where nothing is left at
the tip. Another formulation than the kernel's (which has mu = M + p x N on a Lie group, and a fixed step); it
shares the section's constants, which the golden rows of the reference check.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root

from contid.kinematics.array import Array
from contid.kinematics.cosserat.section import Loads, Rod, Section

PRECISION = 1e-10
State = tuple[Array, Array, Array, Array]


@dataclass(frozen=True)
class Integrated:
    """Ends of sections (k, 3) and tip [mm], frame of the tip, moment left at the tip [N·mm], and more.

    ``frames``: position and rotation by rows at the stations asked for, shape (n, 12).
    """

    ends: Array
    tip: Array
    rotation: Array
    left: Array
    frames: Array


def integrate(
    rod: Rod, pressures: Array, loads: Loads, base_moment: Array, stations: Array | None = None
) -> Integrated:
    """From the clamped base to the tip; ``stations`` are ascending reference arc lengths [mm]."""
    zero = np.zeros(3)
    force = np.array(loads.tip_force, float)
    for i, section in enumerate(rod.sections):
        force = force + loads.joint_force.get(i, zero) + section.length * loads.weight.get(i, zero)
        force = force + section.link * loads.link_weight.get(i, zero)
    places = np.zeros(0) if stations is None else np.asarray(stations, float)
    state: State = (np.zeros(3), np.eye(3), force, np.array(base_moment, float))
    begin, ends, frames = 0.0, [], []
    for i, section in enumerate(rod.sections):
        weight, link_weight = loads.weight.get(i, zero), loads.link_weight.get(i, zero)
        inside = places[(places >= begin) & (places < begin + section.length)] - begin
        state, passed = _through(section, pressures[3 * i : 3 * i + 3], state, weight, inside)
        frames += passed
        begin += section.length
        p, R, N, M = state
        ends.append(p)
        M, N = M - loads.joint_moment.get(i, zero), N - loads.joint_force.get(i, zero)
        axis = R[:, 2]
        for at in places[(places >= begin) & (places < begin + section.link)] - begin:
            frames.append(np.concatenate([p + at * axis, R.ravel()]))
        arm = section.link * axis
        M = M - np.cross(arm, N) + 0.5 * section.link * np.cross(arm, link_weight)
        state = (p + arm, R, N - section.link * link_weight, M)
        begin += section.link
    p, R, _, M = state
    frames += [np.concatenate([p, R.ravel()])] * (len(places) - len(frames))
    return Integrated(np.array(ends), p, R, M - loads.tip_moment, np.array(frames).reshape(len(places), 12))


def equilibrium(rod: Rod, pressures: Array, loads: Loads, guess: Array) -> Array | None:
    """The base moment [N·mm] of an equilibrium near a guess; None where scipy's `root` finds none."""
    left: Callable[[Array], Array] = lambda m: integrate(rod, pressures, loads, m).left  # noqa: E731
    found = root(left, np.asarray(guess, float), options={"xtol": 1e-12})
    balanced = float(np.linalg.norm(left(found.x))) < 1e-6
    return np.asarray(found.x) if balanced else None


def _through(
    section: Section, pressures: Array, state: State, weight: Array, inside: Array
) -> tuple[State, list[Array]]:
    """The state at the end of a section, and frames inside it."""
    modulus = section.modulus(float(np.mean(pressures)))[0]
    shear = modulus / (2.0 * (1.0 + section.poisson))
    bending = np.array([modulus * section.inertia, modulus * section.inertia, shear * section.torsion])
    stretching = np.array([shear * section.area, shear * section.area, modulus * section.area])
    couple = section.pair_moment @ pressures
    push = np.array([0.0, 0.0, section.pair_force * float(np.sum(pressures))])
    N = state[2]

    def rates(s: float, y: Array) -> Array:
        R, M = y[3:12].reshape(3, 3), y[12:15]
        force = N - s * weight
        u = (R.T @ M + couple) / bending
        v = (R.T @ force + push) / stretching
        v[2] += 1.0
        spin = np.array([[0.0, -u[2], u[1]], [u[2], 0.0, -u[0]], [-u[1], u[0], 0.0]])
        dp = R @ v
        a, b, c = dp.tolist()
        x, y_, z = force.tolist()
        dM = (b * z - c * y_, c * x - a * z, a * y_ - b * x)
        return np.concatenate([dp, (R @ spin).ravel(), np.negative(dM)])

    start = np.concatenate([state[0], state[1].ravel(), state[3]])
    solution = solve_ivp(
        rates, (0.0, section.length), start, method="DOP853", rtol=PRECISION, atol=PRECISION,
        dense_output=len(inside) > 0,
    )  # fmt: skip
    passed = [np.asarray(solution.sol(at)[:12]) for at in inside.tolist()]
    end = solution.y[:, -1]
    return (end[:3], end[3:12].reshape(3, 3), N - section.length * weight, end[12:15]), passed
