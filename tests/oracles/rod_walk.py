"""Whether loaded rods get along straight paths of pressures and loads: RK4 on frames, many rods at once.

Independent of contid's integrator, unknowns, step control and count of unstable modes; it shares the
section's constants, which the golden rows of the reference check. Every part of a path must have an
equilibrium near the one before, and the determinant of the moment balance must keep its sign.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.section import Loads, Rod, Section

#: Parts of a path, the same next to a fork, and its least step; elements of a section.
PARTS, FINE_PARTS, LEAST_STEP, ELEMENTS = 60, 300, 1e-5, 20
#: Steps of Newton's method; balance of an equilibrium and step of differences, as parts of the scale.
CORRECTIONS, BALANCED, DIFFERENCE = 6, 1e-7, 1e-5
#: How far a tip may be from where it was a part before, as a part of the reach.
MOST_MOVED = 0.04


#: The least `load_scale` [N·mm].
LEAST_SCALE = 1e-4


def load_scale(rod: Rod, loads: Loads) -> float:
    """What base moments are compared with [N·mm]: that of weights and tip force at full length."""
    total = float(np.linalg.norm(loads.tip_force))
    for i, section in enumerate(rod.sections):
        own = section.length * loads.weight.get(i, np.zeros(3))
        total += float(np.linalg.norm(own + section.link * loads.link_weight.get(i, np.zeros(3))))
    return max(LEAST_SCALE, total * rod.reach)


def carries(rod: Rod, loads: Loads) -> bool:
    """True where a weight or a force on the tip acts."""
    return load_scale(rod, loads) > LEAST_SCALE


@dataclass(frozen=True)
class Walked:
    """Ends of paths: parts that were possible (n,), base moments (n, 3) [N·mm], tips (n, 3) [mm]."""

    done: Array
    moment: Array
    tip: Array

    @property
    def there(self) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
        """Which paths got to their end."""
        return self.done >= 1.0


def _section(
    section: Section, pressures: Array, state: tuple[Array, ...], force: Array, weight: Array
) -> tuple[tuple[Array, ...], Array]:
    """Integrate (position, frame, moment) of rows through a section and its link; the force at its end."""
    mean = np.clip(pressures.mean(axis=1), 0.0, section.modulus_up_to_bar)
    values = np.array([section.modulus(float(x))[0] for x in mean])
    bend, axial = values * section.inertia, values * section.area
    turn = np.stack([bend, bend, values / 3.0 * section.torsion], axis=1)
    shift = np.stack([axial / 3.0, axial / 3.0, axial], axis=1)
    push = np.zeros((len(values), 3))
    push[:, 2] = section.pair_force * pressures.sum(axis=1)
    couple = pressures @ section.pair_moment.T
    h = section.length / ELEMENTS

    def rates(p: Array, R: Array, M: Array, N: Array) -> tuple[Array, Array, Array]:
        back = R.transpose(0, 2, 1)
        u = ((back @ M[:, :, None])[:, :, 0] + couple) / turn
        v = ((back @ N[:, :, None])[:, :, 0] + push) / shift
        v[:, 2] += 1.0
        dp = (R @ v[:, :, None])[:, :, 0]
        spin = np.zeros((len(p), 3, 3))
        spin[:, 0, 1], spin[:, 0, 2], spin[:, 1, 2] = -u[:, 2], u[:, 1], -u[:, 0]
        dR = R @ (spin - spin.transpose(0, 2, 1))
        return dp, dR, -np.cross(dp, N)

    for _ in range(ELEMENTS):
        y = state
        f1, f2, f3 = force, force - 0.5 * h * weight, force - h * weight
        k1 = rates(y[0], y[1], y[2], f1)
        k2 = rates(y[0] + 0.5 * h * k1[0], y[1] + 0.5 * h * k1[1], y[2] + 0.5 * h * k1[2], f2)
        k3 = rates(y[0] + 0.5 * h * k2[0], y[1] + 0.5 * h * k2[1], y[2] + 0.5 * h * k2[2], f2)
        k4 = rates(y[0] + h * k3[0], y[1] + h * k3[1], y[2] + h * k3[2], f3)
        state = tuple(
            a + h / 6.0 * (b + 2.0 * c + 2.0 * d + e) for a, b, c, d, e in zip(y, k1, k2, k3, k4, strict=True)
        )
        force = force - h * weight
    arm = section.link * state[1][:, :, 2]
    return (state[0] + arm, state[1], state[2] - np.cross(arm, force)), force


def shoot(rod: Rod, pressures: Array, loads: Loads, share: Array, moment: Array) -> tuple[Array, Array]:
    """Moments left at the tips [N·mm] and tips [mm], (n, 3) each, of rows under a share (n,) of the loads."""
    count = len(moment)
    share = share[:, None]
    weights = [share * loads.weight.get(i, np.zeros(3)) for i in range(len(rod.sections))]
    force = share * loads.tip_force
    for section, weight in zip(rod.sections, weights, strict=True):
        force = force + section.length * weight
    state: tuple[Array, ...] = (np.zeros((count, 3)), np.tile(np.eye(3), (count, 1, 1)), moment)
    for i, (section, weight) in enumerate(zip(rod.sections, weights, strict=True)):
        state, force = _section(section, pressures[:, 3 * i : 3 * i + 3], state, force, weight)
    return state[2], state[0]


@np.errstate(over="ignore", invalid="ignore")  # of trials that diverge; they are not taken
def walk(
    rod: Rod,
    loads: Loads,
    scale: float,
    pressures: Array,
    pressed: bool = False,
    parts: int = PARTS,
    least: float = LEAST_STEP,
    begin: tuple[Array, Array] | None = None,
) -> Walked:
    """Paths from rest to pressures (n, 3k) [bar] under loads, whose moment is about ``scale`` [N·mm].

    With ``pressed`` the pressures are there in full before the loads. ``begin`` are pressures (n, 3k) [bar]
    and base moments (n, 3) [N·mm] under the loads in full, from where paths go on. Every path has its own
    steps: halved where there is no equilibrium near the prediction, down to a ``least`` part of the path.
    """
    count, eye, nudge = len(pressures), np.eye(3), DIFFERENCE * scale
    low, moment = (pressures * pressed, np.zeros((count, 3))) if begin is None else begin
    loaded = np.full(count, 0.0 if begin is None else 1.0)
    moment, before = moment.copy(), moment.copy()
    tip = shoot(rod, low, loads, loaded, moment)[1]
    done, behind, step = np.zeros(count), np.zeros(count), np.full(count, 1.0 / parts)
    while (live := np.flatnonzero((done < 1.0) & (step > least))).size:
        part = np.minimum(1.0, done[live] + step[live])
        gone = done[live] - behind[live]
        slope = (moment[live] - before[live]) / np.where(gone > 0.0, gone, 1.0)[:, None]
        guess = moment[live] + (part - done[live])[:, None] * slope
        p = np.tile(low[live] + part[:, None] * (pressures - low)[live], (4, 1))
        share, n = np.tile(loaded[live] + part * (1.0 - loaded[live]), 4), len(live)
        good = np.zeros(n, bool)
        A = np.tile(eye, (n, 1, 1))
        for _ in range(CORRECTIONS):
            left, ends = shoot(
                rod, p, loads, share, np.concatenate([guess, *(guess + nudge * e for e in eye)])
            )
            A = ((left.reshape(4, n, 3)[1:] - left[:n]) / nudge).transpose(1, 2, 0)
            good = np.linalg.norm(left[:n], axis=1) <= BALANCED * scale
            if good.all():
                break
            A[~(np.isfinite(A).all(axis=(1, 2)) & (np.abs(np.linalg.det(A)) > 1e-9))] = eye
            guess = guess - np.where(good[:, None], 0.0, np.linalg.solve(A, left[:n, :, None])[:, :, 0])
        near = np.linalg.norm(ends[:n] - tip[live], axis=1) <= MOST_MOVED * rod.reach
        kept = good & near & (np.linalg.det(A) > 0.0)
        there = live[kept]
        before[there], behind[there] = moment[there], done[there]
        moment[there], done[there], tip[there] = guess[kept], part[kept], ends[:n][kept]
        step[there] = np.minimum(1.5 * step[there], 2.0 / parts)
        step[live[~kept]] *= 0.4
    return Walked(done, moment, tip)
