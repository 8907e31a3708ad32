"""Quadratic programs of one shape, and what the runs of the twin of a trunk are judged by."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.kinematics.array import Array
from studies.moving.recordings import PERIOD_S
from studies.moving.trunk_twin import MovingTrunk, violations

#: Of an interior point method, at most.
ITERATIONS: Final = 15


class Program:
    """A quadratic program of one shape, solved again and again: min z'Pz/2 + c'z with low <= Gz <= high."""

    def __init__(self, quadratic: Array) -> None:
        import piqp

        self.quadratic = np.asfortranarray(quadratic)
        self._solver = piqp.DenseSolver()
        self._solver.settings.verbose = False
        self._solver.settings.max_iter = ITERATIONS
        self._solver.settings.eps_abs = self._solver.settings.eps_rel = 1e-4
        self._solved = piqp.Status.PIQP_SOLVED
        self._ready = False
        self.costs: list[float] = []

    def limit(self, iterations: int) -> None:
        """At most this number of iterations."""
        self._solver.settings.max_iter = iterations

    def solved(self, linear: Array, rows: Array, low: Array, high: Array) -> Array | None:
        """The solution, None where it was not reached."""
        begun = time.process_time()
        rows = np.asfortranarray(rows)
        if self._ready:
            self._solver.update(c=linear, G=rows, h_l=low, h_u=high)
        else:
            self._solver.setup(self.quadratic, linear, None, None, rows, low, high)
            self._ready = True
        status = self._solver.solve()
        self.costs.append(time.process_time() - begun)
        if status != self._solved:
            return None
        found = np.array(self._solver.result.x)
        return found if np.isfinite(found).all() else None


@dataclass(frozen=True)
class PredictiveRun:
    """Tips ``(ticks, 2)`` [mm], angles, processor time of ticks and solves [s], ticks that fell back."""

    tips: Array
    angles: Array
    costs: Array
    fallbacks: int
    solves: Array


def of_jump(run: PredictiveRun, twin: MovingTrunk) -> str:
    """Arrival within 5 mm of the place of rest since the tip began to move, and overshoot."""
    tip, rest, begin = run.tips, twin.still(run.angles[-1:])[0], run.tips[0]
    way = float(np.linalg.norm(rest - begin))
    outside = np.flatnonzero(np.linalg.norm(tip - rest, axis=1) > 5.0)
    moved = int(np.argmax(np.linalg.norm(tip - begin, axis=1) > 1.0))
    over = float(((tip - begin) @ (rest - begin) / way).max() / way - 1.0)
    arrival = "never" if outside[-1] + 1 == len(tip) else f"{(outside[-1] + 1 - moved) * PERIOD_S:.2f} s"
    return f"within 5 mm after {arrival}, overshoot {100 * max(over, 0.0):.1f} %"


def cost(run: PredictiveRun) -> str:
    """Violations, ticks that fell back, times of a tick."""
    return (
        f"{violations(run.angles)} violations, {run.fallbacks} fallbacks; tick "
        f"{1e3 * np.median(run.costs):.2f} ms, solve {1e3 * np.median(run.solves):.2f}, "
        f"p99 {1e3 * np.percentile(run.solves, 99):.2f} ms of processor"
    )
