"""Bounded inverse kinematics of a chain of sections: Levenberg-Marquardt steps inside a convex set.

The rows of a task are lengths: tip error, mid-point error, and ``ell (t_target - t)`` for a direction. A step
solves a quadratic programme over the limits (`active_set`), never clips:

* far from the target:   min |J d - e|^2 + (w + mu |e|^2 / (2 ell^2)) |d|^2        (Sugihara's damping)
* near the target:       min |J d - e|^2 + w |d - z|^2,  z towards the home posture

Both dampings are dimensionless because J is: they are scaled by the length ``ell``, a fifth of the arm. With
errors in mm against singular values near 1 the literature's ``lambda^2 = |e|^2/2`` stalls; a damped homing
term leaks into the tip. Homing converges to the answer closest to home, so the answer is a function of the
target and a closed path closes in the lengths as well. It is allowed a bounded number of steps; after them
the error falls monotonically, whatever the target.

Starts: the closed form where there is one, the seed, then the postures of a fixed library whose task is
nearest to the target (for tip and direction: the biarc with the best legs first). The best bounded answer
counts. The specification of ``contid/kernels/section_solver.hpp``: both make the same decisions.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from contid.models import arc, biarc
from contid.models.active_set import convex_step
from contid.models.arc import Array
from contid.models.feasible import Feasible
from contid.models.sections import differentiate, forward
from contid.targets import Vec3

LIBRARY: Final = 256
_PRIMES: Final = (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37)


@dataclass(frozen=True, slots=True)
class Tuning:
    """Numbers of the solver.

    Attributes:
        ell_m: length that scales damping and direction rows [m].
        tolerance_m: error at which a target is met [m].
        home_tolerance_m: step at which the redundancy counts as settled [m].
        weight: w, least damping and weight of homing; leaves ``w * 0.5 m / sigma``, below 1e-8 m, on the tip.
        near: homing starts below ``near * ell_m`` of error.
        home_steps: greatest number of homing steps.
        iterations: greatest number of steps per start.
        starts: starts after the seed for a target that is not met.
    """

    ell_m: float
    tolerance_m: float = 1e-6
    home_tolerance_m: float = 2e-5
    weight: float = 1e-8
    near: float = 0.3
    home_steps: int = 20
    iterations: int = 80
    starts: int = 12


def tuning_for(feasible: Feasible) -> Tuning:
    """Numbers scaled to the size of the robot: ``ell`` is a fifth of the arm in its home posture."""
    return Tuning(ell_m=0.2 * (float(feasible.home.sum()) / 3.0 + sum(feasible.sections.rigid_m)))


class Aim(NamedTuple):
    """What shall be reached: a tip, and maybe its unit tangent or the mid-point, in the base frame [m]."""

    tip: Vec3
    direction: Vec3 | None = None
    mid: Vec3 | None = None


class Answer(NamedTuple):
    """Lengths inside every limit, what they leave of the error [m], and what it took."""

    lengths: tuple[float, ...]
    residual_m: float
    converged: bool
    binding: int
    iterations: int
    starts: int


def vec3(array: Array) -> Vec3:
    """Three floats of an array."""
    return float(array[0]), float(array[1]), float(array[2])


def halton(index: int, prime: int) -> float:
    """The radical inverse of ``index``: deterministic points that fill the unit cube evenly."""
    value, share = 0.0, 1.0
    while index > 0:
        share /= prime
        value += share * (index % prime)
        index //= prime
    return value


class SectionSolver:
    """Inverse kinematics of one chain; the native twin has the same methods and attributes."""

    def __init__(self, feasible: Feasible, tuning: Tuning) -> None:
        self.feasible = feasible
        self.sections = feasible.sections
        self.tuning = tuning
        size = 3 * self.sections.count
        cube = np.array([[halton(k + 1, prime) for prime in _PRIMES[:size]] for k in range(LIBRARY)])
        self._library = np.array(
            [feasible.pulled(feasible.low + c * (feasible.high - feasible.low)) for c in cube]
        )
        self._library_frames = forward(self.sections, self._library)

    def forward(self, lengths: Sequence[float]) -> tuple[Vec3, tuple[float, ...], Vec3]:
        """Tip [m], rotation row by row, end of the first section [m]."""
        frames = forward(self.sections, lengths)
        return vec3(frames.tip), tuple(float(value) for value in frames.rotation.ravel()), vec3(frames.mid)

    def jacobian(self, lengths: Sequence[float]) -> Array:
        """Tip by lengths, shape (3, 3 n)."""
        return differentiate(self.sections, lengths).tip

    def solve(self, tip: Vec3, direction: Vec3 | None, mid: Vec3 | None, seed: Sequence[float]) -> Answer:
        """The best bounded lengths for a tip [m] and maybe its unit tangent or the mid-point [m].

        Continuous from ``seed`` where the target allows it.
        """
        aim = Aim(tip, direction, mid)
        exact = self._closed_form(aim)
        if exact is not None:
            lengths = np.clip(exact, self.feasible.low, self.feasible.high)
            error = float(np.linalg.norm(self._task(lengths, aim)[0]))
            return self._answer(lengths, error, 0, 0)
        best, error, iterations = self._descend(self.feasible.pulled(seed), aim)
        tried = 1
        if error > self.tuning.tolerance_m:
            for start in self._starts(aim):
                lengths, left, steps = self._descend(start, aim)
                iterations += steps
                tried += 1
                # A clear gain only, so that noise does not make the answer jump between equal minima.
                if left <= self.tuning.tolerance_m or left < 0.99 * error:
                    best, error = lengths, left
                if error <= self.tuning.tolerance_m:
                    break
        return self._answer(best, error, iterations, tried)

    def _answer(self, lengths: Array, error: float, iterations: int, tried: int) -> Answer:
        return Answer(
            tuple(float(value) for value in lengths),
            error,
            error <= self.tuning.tolerance_m,
            self.feasible.binding(lengths),
            iterations,
            tried,
        )

    def _closed_form(self, aim: Aim) -> Array | None:
        """Lengths from the closed forms, when they exist and keep every limit."""
        arcs: Sequence[tuple[float, float, float]] | None = None
        rigid = self.sections.rigid_m
        if self.sections.count == 1 and aim.direction is None and aim.mid is None:
            found = arc.through(*aim.tip, rigid[0])
            arcs = None if found is None else (found,)
        elif self.sections.count == 2 and aim.direction is None and aim.mid is not None:
            arcs = biarc.two_arcs(np.array(aim.mid), np.array(aim.tip), (rigid[0], rigid[1]))
        if arcs is None:
            return None
        lengths = self.sections.lengths(np.array(arcs))
        return lengths if float(self.feasible.excess(lengths).max()) <= 1e-12 else None

    def _starts(self, aim: Aim) -> Iterator[Array]:
        """Starts for a target the seed did not reach, most promising first."""
        if self.sections.count == 2 and aim.direction is not None and aim.mid is None:
            yield from self._biarc_starts(aim)
        frames = self._library_frames
        distance = ((frames.tip - aim.tip) ** 2).sum(axis=-1)
        if aim.direction is not None:
            distance += self.tuning.ell_m**2 * ((frames.rotation[:, :, 2] - aim.direction) ** 2).sum(axis=-1)
        if aim.mid is not None:
            distance += ((frames.mid - aim.mid) ** 2).sum(axis=-1)
        for k in np.argsort(distance, kind="stable")[: self.tuning.starts]:
            yield self._library[k]

    def _biarc_starts(self, aim: Aim) -> Iterator[Array]:
        """The three biarcs that exceed the limits least, out of 64 control legs."""
        scored: list[tuple[float, int, Array]] = []
        scale = float(self.feasible.home[:3].mean())
        rigid = self.sections.rigid_m
        for k in range(64):
            leg = 0.5 * scale * math.tan(0.5 * math.pi * ((2 * k + 1) / 64 - 1.0))
            arcs = biarc.biarc(np.array(aim.tip), np.array(aim.direction), leg, (rigid[0], rigid[1]))
            if arcs is None:
                continue
            lengths = self.sections.lengths(np.array(arcs))
            excess = np.maximum(self.feasible.excess(lengths), 0.0)
            from_home = float(((lengths - self.feasible.home) ** 2).sum())
            scored.append((float((excess**2).sum()) + 1e-4 * from_home, k, lengths))
        scored.sort(key=lambda item: item[:2])
        for _, _, lengths in scored[:3]:
            yield self.feasible.pulled(lengths)

    def _task(self, lengths: Array, aim: Aim) -> tuple[Array, Array]:
        """Error rows [m] and their Jacobian at ``lengths``."""
        at = differentiate(self.sections, lengths)
        errors, rows = [np.array(aim.tip) - at.frames.tip], [at.tip]
        if aim.direction is not None:
            tangent = at.frames.rotation[:, 2]
            errors.append(self.tuning.ell_m * (np.array(aim.direction) - tangent))
            rows.append(self.tuning.ell_m * np.cross(at.spin, tangent[:, None], axis=0))
        if aim.mid is not None:
            errors.append(np.array(aim.mid) - at.frames.mid)
            rows.append(at.mid)
        return np.concatenate(errors), np.vstack(rows)

    def _descend(self, lengths: Array, aim: Aim) -> tuple[Array, float, int]:
        """One start: lengths, error [m] and steps taken."""
        t = self.tuning
        e, J = self._task(lengths, aim)
        error = float(np.linalg.norm(e))
        boost, reach, homes_left = 1.0, t.ell_m, t.home_steps
        for iteration in range(1, t.iterations + 1):
            homing = homes_left > 0 and error < t.near * t.ell_m
            if homing:
                homes_left -= 1
                damping = t.weight
                z = self.feasible.home - lengths
                z = z * min(1.0, reach / max(float(np.linalg.norm(z)), 1e-300))
            else:
                damping = t.weight + boost * error * error / (2.0 * t.ell_m * t.ell_m)
                z = np.zeros(len(lengths))
            d = convex_step(J, e, damping, z, lengths, self.feasible)
            trial = self.feasible.pulled(lengths + d)
            step = float(np.abs(trial - lengths).max())
            e_trial, J_trial = self._task(trial, aim)
            trial_error = float(np.linalg.norm(e_trial))
            if homing and trial_error >= t.near * t.ell_m:
                reach *= 0.25
                continue
            if not homing and trial_error >= error and error > t.tolerance_m:
                if step < 1e-9:
                    return lengths, error, iteration
                boost *= 4.0
                continue
            gained = error - trial_error
            lengths, e, J, error = trial, e_trial, J_trial, trial_error
            if not homing:
                boost = max(0.25 * boost, 1e-6)
            if error <= t.tolerance_m and (not homing or step <= t.home_tolerance_m):
                return lengths, error, iteration
            if not homing and gained < 1e-9 * error and step < 1e-7:
                return lengths, error, iteration
        return lengths, error, t.iterations
