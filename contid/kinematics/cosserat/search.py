"""Where solves start: the last command, then the unloaded closed form, then a fixed list of further starts.

A rod under load has several solutions for one target, some of them unstable or on another branch (`branch`),
and bounded least squares has local minima. A solve that does not end on its target in the equilibrium that
counts is followed by a search on the branch (`branch_search`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.along_branch.branch_search import (
    THOROUGH,
    BranchSearch,
    Effort,
    Found,
    at_target,
    reaches,
)
from contid.kinematics.cosserat.along_branch.descent import StopRule, descend, outcome_of
from contid.kinematics.cosserat.along_branch.last_descents import LastDescents, pose_near
from contid.kinematics.cosserat.along_branch.ramp import same_pose
from contid.kinematics.cosserat.branch import MAX_ELEMENTS, equilibrium
from contid.kinematics.cosserat.discretisation import discretisation_error
from contid.kinematics.cosserat.home import home
from contid.kinematics.cosserat.solve import BALANCE_TOLERANCE, Problem, RodSolution, solve
from contid.kinematics.cosserat.stability import unstable_modes
from contid.kinematics.cosserat.starts import predicted_moment, starts, unloaded

#: Iterations from the seed, and from each further start.
ITERATIONS = 60
RESTART_ITERATIONS = 25
#: An optimum this close to the seed continues a motion [bar].
TRACKING = 0.05
#: The load is ramped from the closed form in this many steps, the early ones solved roughly [mm].
LOAD_STEPS = 3
#: Iterations of a bounded optimum with more elements.
FINER_ITERATIONS = 6
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
    # A bounded optimum next to the last command continues a motion; another start would only jump.
    if (
        not attempt(seed, guess, ITERATIONS)
        and not _tracked(problem, best, seed)
        and not _ramp(problem, attempt)
    ):
        if not loaded:
            for start in starts(problem.limits):
                if attempt(start, guess, RESTART_ITERATIONS):
                    break
        for elements in dict.fromkeys((problem.elements, REFUSAL_ELEMENTS)) if loaded else ():
            found = _along_branch(problem, elements, seed, error, effort)
            if found is not None:
                spent += found.iterations
                settled = settle_freedom(replace(problem, elements=found.elements), found.outcome, seed)
                found = found if settled is None else replace(found, outcome=settled)
                if best is None or found.outcome.met or found.outcome.residual < best.outcome.residual:
                    best, descended = found, True
                else:
                    best = replace(best, snap=found.snap)
            if best is not None or elements >= REFUSAL_ELEMENTS:
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


def _along_branch(problem: Problem, elements: int, seed: Array, error: float, effort: Effort) -> Found | None:
    """What a search along the branch finds; out of reach, its candidates descend once more."""
    branch = BranchSearch(replace(problem, elements=elements), seed, effort)
    found = branch.run()
    if found is None or branch.met is not None:
        return found
    last = LastDescents(problem, seed, error, effort.last_work).run(branch)
    return None if last is None else replace(last, iterations=last.iterations + branch.work)


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
    p = outcome.pressures
    reached = equilibrium(problem.rod, p, problem.loads, problem.elements)
    if reached.done < 1.0 or not same_pose(problem, reached.base_moment, outcome.base_moment):
        return False
    if float(np.abs(p - seed).max()) <= TRACKING:
        return True
    return reached_from(problem, seed, outcome)


def reached_from(problem: Problem, seed: Array, outcome: RodSolution) -> bool:
    """True when the arm gets from the seed to an equilibrium on a straight path, or has none at the seed."""
    here = np.clip(seed, problem.limits.lower, problem.limits.upper)
    present = equilibrium(problem.rod, here, problem.loads, problem.elements)
    return present.done < 1.0 or reaches(problem, here, present.base_moment, outcome)[0]


def is_stable(problem: Problem, outcome: RodSolution) -> bool:
    """True for an equilibrium that is a minimum of energy."""
    if outcome.statics > BALANCE_TOLERANCE:
        return False
    if problem.loads.is_zero:
        return True
    return (
        unstable_modes(problem.rod, outcome.pressures, outcome.base_moment, problem.loads, problem.elements)
        == 0
    )


def _tracked(problem: Problem, found: Found | None, seed: Array) -> bool:
    """True where an answer is next to the last command of an arm in motion; one at its lower limits rests."""
    if found is None or bool((seed <= problem.limits.lower).all()):
        return False
    moved = float(np.abs(found.outcome.pressures - seed).max())
    return found.stable and found.outcome.optimal and moved <= TRACKING


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


def refine(problem: Problem, found: Found, seed: Array, error: float, along: bool) -> Found:
    """Double the elements until the estimated error of tip and mid-point is at most ``error``.

    After a descent ``along`` the branch what counts is the pose that the straight path from rest reaches.
    """
    while found.stable and found.elements < MAX_ELEMENTS:
        here, o = replace(problem, elements=found.elements), found.outcome
        estimate = discretisation_error(
            here.rod, o.pressures, o.base_moment, here.loads, here.elements, o.sweep
        )
        if estimate <= error:
            break
        finer = replace(problem, elements=2 * found.elements)
        outcome = solve(finer, o.pressures, o.base_moment, ITERATIONS) if o.met else o
        near = float(np.abs(outcome.pressures - o.pressures).max()) <= TRACKING
        stable = True
        # More elements can end the branch before the pressures that fewer of them reach.
        if not (o.met and outcome.met and is_stable(finer, outcome) and near and _on_branch(finer, outcome)):
            pose, _ = pose_near(finer, o.pressures, seed)
            stable = pose is not None
            if pose is not None:
                outcome = descend(finer, pose, StopRule(RESTART_ITERATIONS if o.met else FINER_ITERATIONS))
                if not _on_branch(finer, outcome):
                    outcome = outcome_of(finer, pose)
            along = True
        found = Found(outcome, stable, finer.elements, found.iterations + outcome.iterations, found.snap)
    if not (along and found.stable):
        return found
    found = on_the_branch(problem, found, seed)
    finer = replace(problem, elements=found.elements)
    if not (found.stable and at_target(found.outcome)):
        return found
    return replace(found, stable=reached_from(finer, seed, found.outcome))


def _on_branch(problem: Problem, outcome: RodSolution) -> bool:
    at = equilibrium(problem.rod, outcome.pressures, problem.loads, problem.elements)
    return at.done == 1.0 and same_pose(problem, at.base_moment, outcome.base_moment)


def on_the_branch(problem: Problem, found: Found, seed: Array) -> Found:
    """The pose that counts for the pressures found along the branch."""
    here, o = replace(problem, elements=found.elements), found.outcome
    pose, _ = pose_near(here, o.pressures, seed)
    if pose is None:
        return replace(found, stable=False)
    same = same_pose(here, pose.base_moment, o.base_moment)
    if same and np.array_equal(pose.pressures, o.pressures):
        return found
    return replace(found, outcome=outcome_of(here, pose))
