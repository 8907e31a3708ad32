"""Where solves start: the last command, then the unloaded closed form, then a fixed list of further starts.

A rod under load has several solutions for one target, some of them unstable, and bounded least squares has
local minima. A solve that does not end on its target in a stable equilibrium is repeated from a fixed list of
starts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.branch import MAX_ELEMENTS, Followed, equilibrium, settle
from contid.kinematics.cosserat.closed_form import (
    mid_and_tip_pressures,
    tip_and_direction_pressures,
    tip_pressures,
)
from contid.kinematics.cosserat.equilibrium import STATICS_TOLERANCE
from contid.kinematics.cosserat.loads import Loads
from contid.kinematics.cosserat.section import Rod
from contid.kinematics.cosserat.solve import BALANCE_TOLERANCE, Limits, Problem, RodSolution, solve
from contid.kinematics.cosserat.spatial import cross
from contid.kinematics.cosserat.stability import unstable_modes
from contid.kinematics.cosserat.statics import Sweep, sweep
from contid.kinematics.cosserat.task import Task
from contid.kinematics.halton import PRIMES, radical_inverse

#: Further starts after the closed form and the centre; each gets fewer iterations than the first.
RESTARTS = 20
ITERATIONS = 60
RESTART_ITERATIONS = 25
#: An optimum this close to the seed continues a motion [bar].
TRACKING = 0.05
#: The load is ramped from the closed form in this many steps, the early ones solved roughly [mm].
LOAD_STEPS = 3
RAMP_TOLERANCE = 1e-2
RAMP_ITERATIONS = 10


@dataclass(frozen=True, slots=True)
class Found:
    """The best outcome, whether it is stable, the elements it took, and all iterations spent."""

    outcome: RodSolution
    stable: bool
    elements: int
    iterations: int


def predicted_moment(rod: Rod, task: Task, loads: Loads) -> Array:
    """Base moment [N·mm] of a rod whose tip is at the target, shape (3,).

    Exact for tip loads; weights are put on the chord.
    """
    moment = cross(task.tip, loads.tip_force) + loads.tip_moment
    done = 0.0
    for i, section in enumerate(rod.sections):
        middle = (done + 0.5 * section.length) / rod.reach
        end = (done + section.length) / rod.reach
        link = (done + section.length + 0.5 * section.link) / rod.reach
        moment = moment + cross(middle * task.tip, section.length * loads.weight.get(i, np.zeros(3)))
        at_end = end * task.tip if task.mid is None or i > 0 else task.mid
        moment = moment + cross(at_end, loads.joint_force.get(i, np.zeros(3)))
        moment = moment + loads.joint_moment.get(i, np.zeros(3))
        moment = moment + cross(link * task.tip, section.link * loads.link_weight.get(i, np.zeros(3)))
        done += section.length + section.link
    return moment


def unloaded(rod: Rod, task: Task, limits: Limits) -> Array | None:
    """Pressures of the closed form [bar], clamped, shape (3k,); None where there is none.

    For a tip direction the member of the family nearest to the centre.
    """
    n = len(rod.sections)
    try:
        with np.errstate(all="ignore"):
            if n == 1:
                return _usable(tip_pressures(rod.sections[0], task.tip), limits)
            if n > 2:
                return None
            if task.mid is not None:
                return _usable(mid_and_tip_pressures(rod, task.mid, task.tip), limits)
            if task.direction is None:
                return None
            members = []
            for d1 in np.linspace(0.3, 1.1, 9) * rod.sections[0].length:
                member = _usable(
                    tip_and_direction_pressures(rod, task.tip, task.direction, float(d1)), limits, clamp=False
                )
                if member is not None:
                    members.append(member)
    except (ZeroDivisionError, np.linalg.LinAlgError):
        return None
    if not members:
        return None
    best = min(members, key=lambda member: float(np.sum((member - limits.centre) ** 2)))
    return np.clip(best, limits.lower, limits.upper)


def _usable(pressures: Array, limits: Limits, clamp: bool = True) -> Array | None:
    if not np.all(np.isfinite(pressures)):
        return None
    return np.clip(pressures, limits.lower, limits.upper) if clamp else pressures


def starts(limits: Limits) -> Iterator[Array]:
    """The centre, then Halton points of the box [bar], shape (3k,) each."""
    yield limits.centre
    for index in range(1, RESTARTS + 1):
        share = np.array([radical_inverse(index, PRIMES[axis]) for axis in range(len(limits.lower))])
        yield limits.lower + share * (limits.upper - limits.lower)


def search(problem: Problem, seed: Array, error: float = np.inf) -> Found:
    """Solve from the seed; where that does not end on the target in a stable equilibrium, from elsewhere.

    Args:
        problem: what to solve, with the minimum number of elements.
        seed: the last commanded pressures [bar].
        error: estimated discretisation error [mm] at which the elements are doubled.
    """
    guess = predicted_moment(problem.rod, problem.task, problem.loads)
    spent = 0
    best: Found | None = None

    def attempt(start: Array, moment: Array, iterations: int) -> bool:
        nonlocal best, spent
        outcome = solve(problem, start, moment, iterations)
        spent += outcome.iterations
        candidate = Found(outcome, is_stable(problem, outcome), problem.elements, spent)
        if best is None or _rank(candidate) < _rank(best):
            best = candidate
        return outcome.met and candidate.stable

    # A bounded optimum next to the last command continues a motion; another start would only jump.
    if not attempt(seed, guess, ITERATIONS) and not _tracked(best, seed) and not _ramp(problem, attempt):
        for start in starts(problem.limits):
            if attempt(start, guess, RESTART_ITERATIONS):
                break
    assert best is not None
    best = Found(best.outcome, best.stable, best.elements, spent)
    if best.stable and not problem.loads.none:
        best = refine(problem, best, error)
    return best


def is_stable(problem: Problem, outcome: RodSolution) -> bool:
    """True for an equilibrium that is a minimum of energy."""
    if outcome.statics > BALANCE_TOLERANCE:
        return False
    if problem.loads.none:
        return True
    return (
        unstable_modes(problem.rod, outcome.pressures, outcome.base_moment, problem.loads, problem.elements)
        == 0
    )


def _tracked(found: Found | None, seed: Array) -> bool:
    assert found is not None
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
    if not loads.none:
        for k in range(1, LOAD_STEPS):
            part = replace(problem, loads=loads.scaled(k / LOAD_STEPS), tolerance=RAMP_TOLERANCE)
            start = solve(part, start, predicted_moment(rod, task, part.loads), RAMP_ITERATIONS).pressures
    return attempt(start, predicted_moment(rod, task, loads), RESTART_ITERATIONS)


def refine(problem: Problem, found: Found, error: float) -> Found:
    """Double the elements until the estimated error of the tip is at most ``error``."""
    while found.elements < MAX_ELEMENTS:
        here = replace(problem, elements=found.elements)
        o = found.outcome
        if (
            discretisation_error(here.rod, o.pressures, o.base_moment, here.loads, here.elements, o.sweep)
            <= error
        ):
            break
        finer = replace(problem, elements=2 * found.elements)
        outcome = solve(finer, found.outcome.pressures, found.outcome.base_moment, ITERATIONS)
        stable = is_stable(finer, outcome)
        found = Found(outcome, stable, finer.elements, found.iterations + outcome.iterations)
        if not stable:
            break
    return found


def discretisation_error(
    rod: Rod, pressures: Array, base_moment: Array, loads: Loads, n: int, here: Sweep
) -> float:
    """Estimated error [mm] of the tip and of the end of the first section of a sweep with n elements.

    From a sweep with a third of them: for a method of fourth order the results of n and m < n elements differ
    by ``(n/m)^4 - 1`` times the error of n. The equilibrium of the coarser rod is included to first order.
    """
    m = max(1, n // 3) if n > 1 else 2
    other = sweep(rod, pressures, base_moment, loads, m)
    assert here.tangents is not None
    turn = np.linalg.solve(here.tangents.moment[:, :3], other.moment - here.moment)
    tip = other.tip - here.tip - here.tangents.tip[:, :3] @ turn
    mid = other.ends[0] - here.ends[0] - here.tangents.ends[0][:, :3] @ turn
    return max(float(np.linalg.norm(tip)), float(np.linalg.norm(mid))) / abs((n / m) ** 4 - 1.0)


def fine_equilibrium(
    rod: Rod, pressures: Array, loads: Loads, elements: int, error: float
) -> tuple[Followed, int]:
    """`branch.equilibrium` with as many elements as ``error`` [mm] demands; also their number.

    A branch that ends short of the full load is followed with more elements before that counts.
    """
    found: Followed | None = None
    while True:
        if found is not None and found.done == 1.0:
            finer = settle(rod, pressures, found.base_moment, loads, elements, STATICS_TOLERANCE)
            found = None if finer is None else Followed(finer.base_moment, finer.sweep, 1.0)
        else:
            found = None
        if found is None:
            found = equilibrium(rod, pressures, loads, elements)
        if elements >= MAX_ELEMENTS or loads.none:
            return found, elements
        if found.done == 1.0:
            estimate = discretisation_error(rod, pressures, found.base_moment, loads, elements, found.sweep)
            if estimate <= error:
                return found, elements
        elements *= 2
