"""Where solves start: the last command, then the unloaded closed form, then a fixed list of further starts.

A rod under load has several solutions for one target, some of them unstable or on another branch (`branch`),
and bounded least squares has local minima. A solve that does not end on its target in the equilibrium that
counts is followed by a search on the branch (`along_branch.branch_search`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.along_branch.branch_search import BranchSearch, Found
from contid.kinematics.cosserat.along_branch.effort import THOROUGH, Effort
from contid.kinematics.cosserat.along_branch.last_descents import LastDescents, standing_error
from contid.kinematics.cosserat.along_branch.refine import (
    ITERATIONS,
    RESTART_ITERATIONS,
    TRACKING,
    refine,
)
from contid.kinematics.cosserat.along_branch.straight_path import holds, is_stable, reached_from
from contid.kinematics.cosserat.home import home
from contid.kinematics.cosserat.solve import Problem, RodSolution, solve
from contid.kinematics.cosserat.starts import predicted_moment, starts, unloaded

#: The load is ramped from the closed form in this many steps, the early ones solved roughly [mm].
LOAD_STEPS = 3
#: Elements with which a search that found no stable pose is repeated before the target is refused.
REFUSAL_ELEMENTS = 12
RAMP_TOLERANCE = 1e-2
RAMP_ITERATIONS = 10


def search(problem: Problem, seed: Array, error: float = np.inf, effort: Effort = THOROUGH) -> Found:
    """Solve from the seed; where that does not end on the target and on the branch, from elsewhere.

    Args:
        problem: what to solve, with the minimum number of elements.
        seed: the last commanded pressures [bar].
        error: estimated discretisation error [mm] at which the elements are doubled.
        effort: of a search on the branch.
    """
    guess = predicted_moment(problem.rod, problem.task, problem.loads)
    loaded = not problem.loads.is_zero
    spent = 0
    best: Found | None = None

    def attempt(start: Array, moment: Array, iterations: int) -> bool:
        nonlocal best, spent
        outcome = solve(problem, start, moment, iterations)
        spent += outcome.iterations
        settled = settle_freedom(problem, outcome, seed)
        if settled is not None:
            outcome = settled
        candidate = Found(outcome, is_stable(problem, outcome), problem.elements, spent)
        usable = outcome.met or (outcome.optimal and start is seed)
        if loaded and not (candidate.stable and usable and is_on_branch(problem, outcome, seed)):
            return False
        if best is None or _rank(candidate) < _rank(best):
            best = candidate
        return outcome.met and candidate.stable

    descended = False
    # A bounded optimum next to the last command, and not farther than where the arm stands, continues a
    # motion; another start would only jump.
    if (
        not attempt(seed, guess, ITERATIONS)
        and not _tracked(problem, best, seed, error)
        and not _ramp(problem, attempt)
    ):
        if not loaded:
            for start in starts(problem.limits, effort.restarts):
                if attempt(start, guess, RESTART_ITERATIONS):
                    break
        for elements in dict.fromkeys((problem.elements, REFUSAL_ELEMENTS)) if loaded else ():
            found, work = _along_branch(problem, elements, seed, error, effort)
            spent += work
            if found is not None:
                settled = settle_freedom(replace(problem, elements=found.elements), found.outcome, seed)
                found = found if settled is None else replace(found, outcome=settled)
                if best is None or found.outcome.met or found.outcome.residual < best.outcome.residual:
                    best, descended = found, True
                else:
                    best = replace(best, snap=found.snap)
            if found is not None or elements >= REFUSAL_ELEMENTS:
                break
    if best is None:
        held = solve(problem, seed, guess, 1)
        return Found(held, False, problem.elements, spent)
    best = replace(best, iterations=spent)
    if not (best.stable and loaded):
        return best
    refined = refine(problem, best, seed, error, descended)
    lost = best.outcome.met and not (refined.stable and refined.outcome.met)
    if not lost or not problem.elements < refined.elements <= effort.again:
        return refined
    again = search(replace(problem, elements=refined.elements), seed, error, effort)
    spent = refined.iterations + again.iterations
    better = not refined.stable or again.outcome.met or again.outcome.residual < refined.outcome.residual
    return replace(again if again.stable and better else refined, iterations=spent)


def _along_branch(
    problem: Problem, elements: int, seed: Array, error: float, effort: Effort
) -> tuple[Found | None, int]:
    """What a search along the branch finds, and its work; out of reach, its candidates descend once more."""
    branch = BranchSearch(replace(problem, elements=elements), seed, effort)
    found = branch.run()
    if found is None or branch.met is not None:
        return found, branch.work
    last = LastDescents(problem, seed, error, effort.last_work)
    return last.run(branch), branch.work + last.spent


def settle_freedom(problem: Problem, outcome: RodSolution, seed: Array) -> RodSolution | None:
    """An answer to a redundant task moved nearest to the centre; None where that does not count."""
    if not outcome.met or problem.task.rows >= problem.rod.pressures:
        return None
    settled = home(problem, outcome)
    loaded = not problem.loads.is_zero
    counts = is_stable(problem, settled) and (not loaded or is_on_branch(problem, settled, seed))
    return settled if counts else None


def is_on_branch(problem: Problem, outcome: RodSolution, seed: Array) -> bool:
    """True when an equilibrium is the one that counts, and the arm gets there from the seed without a jump.

    The kernel takes a shorter way to the same verdict next to the seed.
    """
    if not holds(problem, outcome):
        return False
    near = float(np.abs(outcome.pressures - seed).max()) <= TRACKING
    return near or reached_from(problem, seed, outcome)


def _tracked(problem: Problem, found: Found | None, seed: Array, error: float) -> bool:
    """True where an answer is next to the last command of an arm in motion; one at its lower limits rests."""
    if found is None or bool((seed <= problem.limits.lower).all()):
        return False
    moved = float(np.abs(found.outcome.pressures - seed).max())
    if not (found.stable and found.outcome.optimal and moved <= TRACKING):
        return False
    return problem.loads.is_zero or found.outcome.residual <= standing_error(problem, seed, error)


def _rank(found: Found) -> tuple[bool, bool, float]:
    return (not found.stable, not found.outcome.met, found.outcome.residual)


def _ramp(problem: Problem, attempt: Callable[[Array, Array, int], bool]) -> bool:
    """From the unloaded closed form to the full load in steps, on one branch."""
    rod, task, loads = problem.rod, problem.task, problem.loads
    start = unloaded(rod, task, problem.limits)
    if start is None:
        return False
    if not loads.is_zero:
        for k in range(1, LOAD_STEPS):
            part = replace(problem, loads=loads.scaled(k / LOAD_STEPS), tolerance=RAMP_TOLERANCE)
            start = solve(part, start, predicted_moment(rod, task, part.loads), RAMP_ITERATIONS).pressures
    return attempt(start, predicted_moment(rod, task, loads), RESTART_ITERATIONS)
