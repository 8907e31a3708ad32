"""Bounded inverse kinematics of a chain of sections: descents from several starts, and the best result.

The closed form comes first where there is one, then a `descent` from the seed. Where that does not meet the
target, further descents start from biarcs (for tip and direction) and from the nearest postures of a fixed
library. Specification of ``contid/kernels/arc/section_solver.hpp``: both make the same decisions.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from contid.kinematics.arc import arc, biarc
from contid.kinematics.arc.avoid import Avoid
from contid.kinematics.arc.descent import Descent
from contid.kinematics.arc.feasible import BoundedChain
from contid.kinematics.arc.sections import Sections, differentiate, forward
from contid.kinematics.arc.solver import SectionSolution
from contid.kinematics.arc.task import Goal, Tuning
from contid.kinematics.array import Array
from contid.kinematics.halton import PRIMES, radical_inverse
from contid.targets import Vec3, vec3

#: Number of postures in the library of starts.
LIBRARY: Final = 256
#: Starts of the library for a body that is not clear of obstacles, and steps after which none is begun:
#: of the answers that 32 starts find, 99.7 % take less.
_AROUND: Final = 32
_AROUND_STEPS: Final = 300
# Larger than the error of any arm [m]; its square does not overflow.
MAX_ERROR_M: Final = 1e6
#: A start of a whole frame that fails is left after as many Newton steps: most are met from the next one.
BRIEF: Final = 10


class SectionSolver:
    """`Solver` of one chain in NumPy: specification of the kernels."""

    def __init__(self, feasible: BoundedChain, tuning: Tuning) -> None:
        self.feasible = feasible
        self.sections = feasible.sections
        self.tuning = tuning
        self._descent = Descent(feasible, tuning)
        size = len(feasible.home)
        cube = np.array([[radical_inverse(k + 1, prime) for prime in PRIMES[:size]] for k in range(LIBRARY)])
        self._library = np.array(
            [feasible.pulled(feasible.low + c * (feasible.high - feasible.low)) for c in cube]
        )
        self._library_frames = forward(self.sections, self._library)
        self._avoid: Avoid | None = None

    def avoid(
        self,
        obstacles: Sequence[Sequence[float]],
        radius: float,
        margin: float,
        from_: float,
        zone: float,
        force: float,
    ) -> None:
        """Keep redundant axes away from obstacles, all in m as in `Avoid`; none switches that off."""
        rows = np.array(obstacles, dtype=np.float64).reshape(-1, 17)
        self._avoid = Avoid(rows, radius, margin, from_, zone, force) if len(rows) else None

    def forward(self, lengths: Sequence[float]) -> tuple[Vec3, tuple[float, ...], Vec3]:
        """Tip [m], rotation row by row, end of the first section [m]."""
        frames = forward(self.sections, lengths)
        rotation = tuple(frames.rotation.ravel().tolist())
        return vec3(frames.tip.tolist()), rotation, vec3(frames.mid.tolist())

    def differentiate(self, lengths: Sequence[float], tip: Array, spin: Array, mid: Array) -> None:
        """Jacobians of tip, orientation and mid-point, into arrays ``(3, 3 n)`` the caller made."""
        at = differentiate(self.sections, lengths)
        tip[...], spin[...], mid[...] = at.tip, at.spin, at.mid

    def solve(
        self,
        tip: Vec3,
        direction: Vec3 | None,
        mid: Vec3 | None,
        seed: Sequence[float],
        rotation: tuple[float, ...] | None = None,
    ) -> SectionSolution:
        """The best bounded lengths for a tip [m] and maybe its unit tangent, its frame or the mid-point [m].

        Continuous from ``seed`` where the target allows it.
        """
        goal = Goal(tip, direction, mid, rotation)
        if self._avoid is not None and self._redundant(goal):
            around = self._solve_around(goal, seed, self._avoid)
            if around is not None:
                return around
        exact = self._closed_form(goal)
        if exact is not None:
            lengths = np.clip(exact, self.feasible.low, self.feasible.high)
            error = self._descent.error(lengths, goal)
            return self._answer(lengths, error, 0, 0)
        start = self.feasible.pulled(seed)
        away = self._descent.error(start, goal)
        if not away < MAX_ERROR_M:  # NaN included
            return self._answer(start, away, 0, 0)
        settling = self.tuning.settling if rotation is None else min(BRIEF, self.tuning.settling)
        best, error, iterations = self._descent.run(start, goal, settling=settling)
        tried = agreeing = 1
        beyond = math.dist(goal.tip, (0.0, 0.0, 0.0)) > self.feasible.longest_m
        tracked = self._tracked(start, best)
        # 2 * LIBRARY: no bound. See `Tuning.agreeing` and `Tuning.tracking`.
        enough = self.tuning.agreeing if beyond else 2 * LIBRARY
        most = self.tuning.agreeing if tracked else 2 * LIBRARY
        if error > self.tuning.tolerance_m:
            for start in self._starts(goal):
                lengths, left, steps = self._descent.run(start, goal, settling=settling)
                iterations += steps
                tried += 1
                # Only a gain above 0.1 %, so that rounding cannot make the answer jump between equal minima.
                if left <= self.tuning.tolerance_m or left < 0.999 * error:
                    best, error, agreeing = lengths, left, 1
                elif left < 1.001 * error:
                    agreeing += 1
                if error <= self.tuning.tolerance_m or agreeing >= enough or tried >= most:
                    break
            if rotation is not None and error > self.tuning.tolerance_m:
                best, error, steps = self._descent.run(best, goal)
                iterations += steps
        return self._answer(best, error, iterations, tried)

    def _redundant(self, goal: Goal) -> bool:
        """True when a task leaves axes free. A direction holds two."""
        held = 2 * (goal.direction is not None) + 3 * (goal.rotation is not None) + 3 * (goal.mid is not None)
        return len(self.feasible.home) > 3 + held

    def _tracked(self, start: Array, found: Array) -> bool:
        """True where a descent moved so little that it follows an optimum from tick to tick."""
        return float(np.abs(found - start).max()) <= self.tuning.tracking * self.tuning.ell_m

    def _solve_around(self, goal: Goal, seed: Sequence[float], avoid: Avoid) -> SectionSolution | None:
        """An answer that keeps the margin, from the seed or, unless that is tracked, from the library.

        Without one the answer from the seed that meets the target, as far off as it can be; None when there
        is none.
        """
        start = self.feasible.pulled(seed)
        if not self._descent.error(start, goal) < MAX_ERROR_M:
            return None
        best, error, iterations = self._descent.run(start, goal, avoid)
        met, tried = error <= self.tuning.tolerance_m, 1
        if met and (avoid.clear(self.sections, best) or self._tracked(start, best)):
            return self._answer(best, error, iterations, tried)
        for begin in self._library_starts(goal, _AROUND):
            if iterations >= _AROUND_STEPS:
                break
            lengths, left, steps = self._descent.run(begin, goal, avoid)
            iterations += steps
            tried += 1
            if left <= self.tuning.tolerance_m and avoid.clear(self.sections, lengths):
                return self._answer(lengths, left, iterations, tried)
        return self._answer(best, error, iterations, tried) if met else None

    def _answer(self, lengths: Array, error: float, iterations: int, tried: int) -> SectionSolution:
        return SectionSolution(
            tuple(lengths.tolist()),
            error,
            error <= self.tuning.tolerance_m,
            self.feasible.binding(lengths),
            iterations,
            tried,
        )

    def _closed_form(self, goal: Goal) -> Array | None:
        """Lengths from the closed forms, if they exist and are inside every limit."""
        if not isinstance(self.sections, Sections):  # sections of fixed length have no closed form
            return None
        if goal.rotation is not None:
            return None
        arcs: Sequence[tuple[float, float, float]] | None = None
        rigid = self.sections.rigid_m
        if self.sections.count == 1 and goal.direction is None and goal.mid is None:
            found = arc.through(*goal.tip, rigid[0])
            arcs = None if found is None else (found,)
        elif self.sections.count == 2 and goal.direction is None and goal.mid is not None:
            arcs = biarc.two_arcs(np.array(goal.mid), np.array(goal.tip), (rigid[0], rigid[1]))
        if arcs is None:
            return None
        lengths = self.sections.lengths(np.array(arcs))
        return lengths if float(np.max(self.feasible.excess(lengths))) <= 1e-12 else None

    def _starts(self, goal: Goal) -> Iterator[Array]:
        """Starts for a target the seed did not reach, most promising first."""
        sections, directed = self.sections, goal.direction is not None and goal.mid is None
        if isinstance(sections, Sections) and sections.count == 2 and directed:
            yield from self._biarc_starts(sections, goal)
        yield from self._library_starts(goal, self.tuning.starts)

    def _library_starts(self, goal: Goal, count: int) -> Iterator[Array]:
        """Postures of the library whose task is nearest to the goal, then with growing strides."""
        frames = self._library_frames
        distance = ((frames.tip - goal.tip) ** 2).sum(axis=-1)
        if goal.direction is not None:
            distance += self.tuning.ell_m**2 * ((frames.rotation[:, :, 2] - goal.direction) ** 2).sum(axis=-1)
        if goal.rotation is not None:
            off = frames.rotation - np.reshape(goal.rotation, (3, 3))
            distance += 0.5 * self.tuning.ell_m**2 * (off**2).sum(axis=(1, 2))
        if goal.mid is not None:
            distance += ((frames.mid - goal.mid) ** 2).sum(axis=-1)
        order = np.argsort(distance, kind="stable")
        for k in range(count):
            yield self._library[order[min(k * (k + 7) // 8, LIBRARY - 1)]]

    def _biarc_starts(self, sections: Sections, goal: Goal) -> Iterator[Array]:
        """The three biarcs that exceed the limits least, out of 64 control legs."""
        scored: list[tuple[float, int, Array]] = []
        scale = float(self.feasible.home[:3].mean())
        rigid = sections.rigid_m
        for k in range(64):
            leg = 0.5 * scale * math.tan(0.5 * math.pi * ((2 * k + 1) / 64 - 1.0))
            arcs = biarc.biarc(np.array(goal.tip), np.array(goal.direction), leg, (rigid[0], rigid[1]))
            if arcs is None:
                continue
            lengths = sections.lengths(np.array(arcs))
            excess = np.maximum(self.feasible.excess(lengths), 0.0)
            from_home = float(((lengths - self.feasible.home) ** 2).sum())
            scored.append((float((excess**2).sum()) + 1e-4 * from_home, k, lengths))
        scored.sort(key=lambda item: item[:2])
        for _, _, lengths in scored[:3]:
            yield self.feasible.pulled(lengths)
