"""Table of inverse kinematics of two to seven segments: ``python -m studies.multi_segment --cases N``.

contid's compiled solver beside six methods in NumPy, over the same poses, from the straight arm, in one
process (see `studies.segment_arms`). A method in NumPy runs until 1e-8 m or the most iterations; the
three tolerances are read off on the way. contid is solved for each tolerance. Times are of the solver
alone, without the judge, and of met poses.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import Final

import click
import numpy as np

from contid.kernels import load
from contid.kinematics.arc.solver import Tuning
from contid.kinematics.array import Array
from studies import jacobian_methods, reaching_methods
from studies.arc_chains import Goal
from studies.segment_arms import SegmentArm

TOLERANCES_M: Final = (1e-4, 1e-6, 1e-8)
METHODS: Final[dict[str, Callable[[SegmentArm, Goal], Iterator[Array]]]] = {
    "Jacobian transpose": jacobian_methods.transpose,
    "pseudo-inverse": jacobian_methods.pseudo_inverse,
    "damped least squares, 0.2": jacobian_methods.damped_least_squares,
    "damped least squares, 0.5": partial(jacobian_methods.damped_least_squares, damping=0.5),
    "virtual variable length": jacobian_methods.virtual_variable_length,
    "FABRIKc": reaching_methods.fabrikc,
    "CRRIK": reaching_methods.crrik,
}


@dataclass(slots=True)
class Row:
    """One method at one tolerance: for each pose iterations and time [ms] if it was met."""

    method: str
    tolerance_m: float
    cases: int = 0
    iterations: list[int] = field(default_factory=list)
    times_ms: list[float] = field(default_factory=list)

    @property
    def met(self) -> float:
        """Share of the poses that were met."""
        return len(self.times_ms) / self.cases


def stepped(method: str, arm: SegmentArm, goals: list[Goal], most: int) -> list[Row]:
    """Rows of a method in NumPy, one per tolerance."""
    rows = [Row(method, tolerance, len(goals)) for tolerance in TOLERANCES_M]
    for goal in goals:
        steps, took, open_rows = METHODS[method](arm, goal), 0.0, list(rows)
        for iteration in range(1, most + 1):
            start = time.perf_counter()
            bends = next(steps, None)
            took += time.perf_counter() - start
            if bends is None:  # given up
                break
            error = arm.error_m(bends, goal)
            while open_rows and error <= open_rows[0].tolerance_m:
                row = open_rows.pop(0)
                row.iterations.append(iteration)
                row.times_ms.append(1e3 * took)
            if not open_rows:
                break
    return rows


def ours(arm: SegmentArm, goals: list[Goal]) -> list[Row]:
    """Rows of contid's solver of bends."""
    kernel = load("tendon")
    sections, bend_max_rad, rows = arm.sections, (arm.bend_max_rad,) * arm.count, []
    for tolerance in TOLERANCES_M:
        # Half: the judge computes the same error by other formulas.
        tuning = Tuning(ell_m=arm.ell_m, tolerance_m=0.5 * tolerance, still_m=1e-5, still_error_m=1e-8)
        solver = kernel.SectionSolver(
            sections.backbone_m, sections.rigid_m, sections.offset_m, bend_max_rad, [], [], tuning
        )
        row = Row("contid, kernel", tolerance, len(goals))
        for goal in goals:
            start = time.perf_counter()
            answer = solver.solve(goal.tip, goal.direction, None, (0.0,) * (2 * arm.count))
            took = time.perf_counter() - start
            bends = np.reshape(answer.lengths, (arm.count, 2)) / arm.length_m
            inside = bool(np.all(np.hypot(*bends.T) <= arm.bend_max_rad + 1e-9))
            if inside and arm.error_m(bends, goal) <= tolerance:
                row.iterations.append(answer.iterations)
                row.times_ms.append(1e3 * took)
        rows.append(row)
    return rows


def compared(arm: SegmentArm, cases: int, direction: bool, seed: int, most: int) -> list[Row]:
    """Rows of every method over the same poses."""
    goals = arm.goals(cases, direction, seed)
    rows = ours(arm, goals)
    for method in METHODS:
        rows += stepped(method, arm, goals, most)
    return rows


@click.command()
@click.option(
    "--cases", default=50, show_default=True, type=click.IntRange(1), help="Poses per arm and task."
)
@click.option("--segments", default="2-7", show_default=True, help="Number of segments, or FIRST-LAST.")
@click.option("--iterations", default=200, show_default=True, type=click.IntRange(1), help="Most, in NumPy.")
@click.option("--seed", default=16, show_default=True, help="Of the random poses.")
def main(cases: int, segments: str, iterations: int, seed: int) -> None:
    """Compare inverse kinematics of arms of several segments; times are of met poses, medians."""
    first, _, last = segments.partition("-")
    try:
        counts = range(int(first), int(last or first) + 1)
    except ValueError:
        counts = range(0)
    if not counts or counts[0] < 2 or counts[-1] > 8:
        raise click.BadParameter(f"{segments!r}; allowed: 2 to 8, like 3 or 2-7", param_hint="--segments")
    click.echo(f"{cases} poses each; met, iterations and median time at 1e-4 / 1e-6 / 1e-8 m; p99 at 1e-6 m")
    click.echo("| segments | pose | method | met [%] | iterations | time [ms] | p99 [ms] |")
    click.echo("|---|---|---|---|---|---|---|")
    for count in counts:
        for direction in (False, True) if count > 2 else (False,):
            rows = compared(SegmentArm(count), cases, direction, seed, iterations)
            pose = "tip and tangent" if direction else "tip"
            for method in dict.fromkeys(row.method for row in rows):
                figures = _figures([row for row in rows if row.method == method])
                click.echo(f"| {count} | {pose} | {method} | {figures} |")


def _figures(rows: list[Row]) -> str:
    met = " / ".join(f"{100 * row.met:.3g}" for row in rows)
    steps = " / ".join(f"{np.median(row.iterations):.0f}" if row.iterations else "-" for row in rows)
    times = " / ".join(f"{np.median(row.times_ms):.2g}" if row.times_ms else "-" for row in rows)
    slow = f"{np.percentile(rows[1].times_ms, 99):.2g}" if rows[1].times_ms else "-"
    return f"{met} | {steps} | {times} | {slow}"


if __name__ == "__main__":
    main()
