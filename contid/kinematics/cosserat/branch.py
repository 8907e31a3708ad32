"""The branch of equilibria on which the arm stands.

A loaded rod has several equilibria, some of them stable. The one that counts is reached when pressures and
loads grow together from zero, without a jump; where it loses its stability on the way, the arm snaps through
to an equilibrium that statics does not determine. Forward and inverse share this definition.

A path stays on its branch because each point must be stable, lie in the neighbourhood of its prediction in
which Newton's method contracts, and have about the stiffness predicted; otherwise the step is halved.
Specification of ``contid/kernels/cosserat/branch.hpp``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.equilibrium import ROUNDING, STATICS_TOLERANCE, Equilibrium, newton
from contid.kinematics.cosserat.loads import Loads
from contid.kinematics.cosserat.section import Rod
from contid.kinematics.cosserat.spatial import cross
from contid.kinematics.cosserat.stability import unstable_modes
from contid.kinematics.cosserat.statics import Sweep, sweep

#: Steps of Newton's method at one point of a path, and how much each must shrink the balance.
CORRECTIONS = 8
CONTRACTION = 0.3
#: How far the stiffness may be from its prediction, as a part of the smaller one at both ends of a step: it
#: changes abruptly where a path passes near a fork, and a longer step could end on the other side. Steps of
#: less than this part are short enough; towards a critical load the stiffness of some rods is a square.
PREDICTED, SHORT_STEP = 2.0, 4e-3
#: How far a base moment may be from its prediction, as a part of the larger one at both ends of a step:
#: farther away Newton's method has found another equilibrium.
CORRECTED = 0.2
#: Parts of a path: first and least step, and the least one of all: a path that fails at its start ends.
FIRST_STEP = 0.25
LEAST_STEP = 5e-5
TINY_STEP = 1e-6
#: Moment balance at the points before the last, as a part of `load_scale` and of `stiffness`: where the arm
#: is soft, a small moment moves it far, and the next point is predicted from there.
ON_THE_WAY = 1e-5
#: Difference of base moments of one and the same equilibrium, as a part of `load_scale`.
SAME_POSE = 1e-4
#: Two critical factors that agree.
SAME_FACTOR = 5e-3
MAX_ELEMENTS = 48
#: The least `load_scale` [N·mm]: parts of less than this are rounding.
LEAST_SCALE = 1e-4


@dataclass(frozen=True, slots=True)
class Station:
    """One end of a straight path in pressures [bar] and loads."""

    pressures: Array
    loads: Loads


@dataclass(frozen=True, slots=True)
class Followed:
    """Where a path ends.

    Attributes:
        base_moment: of the last equilibrium reached [N·mm].
        sweep: the integration that belongs to it.
        done: part of the path that was possible, to 0.005 %; 1.0 for all of it.
        least: the least `stiffness` on the path, at most 1.
    """

    base_moment: Array
    sweep: Sweep
    done: float
    least: float = 1.0


def load_scale(rod: Rod, loads: Loads) -> float:
    """What base moments are compared with [N·mm]: that of all loads at full length, or `LEAST_SCALE`."""
    total = float(np.linalg.norm(loads.tip_force)) * rod.reach + float(np.linalg.norm(loads.tip_moment))
    for i, section in enumerate(rod.sections):
        own = section.length * loads.weight.get(i, np.zeros(3))
        own = own + section.link * loads.link_weight.get(i, np.zeros(3))
        total += float(np.linalg.norm(own)) * rod.reach
        total += float(np.linalg.norm(loads.joint_force.get(i, np.zeros(3)))) * rod.reach
        total += float(np.linalg.norm(loads.joint_moment.get(i, np.zeros(3))))
    return max(LEAST_SCALE, total)


def tolerance_on_the_way(scale: float, stiff: float) -> float:
    """Moment balance of a point before the last [N·mm], by the `stiffness` of the point before it."""
    return max(statics_tolerance(scale), ON_THE_WAY * scale * min(1.0, abs(stiff)))


def statics_tolerance(scale: float) -> float:
    """Moment balance that counts as equilibrium [N·mm] for loads of that `load_scale`."""
    return max(STATICS_TOLERANCE, ROUNDING * scale)


def settle(
    rod: Rod, pressures: Array, start: Array, loads: Loads, elements: int, tolerance: float
) -> Equilibrium | None:
    """Newton's method that ends where a step does not contract the balance; None unless stable.

    A dead moment has no energy, so that stability is not defined and not asked for (`stability`).
    """
    moment, before = np.array(start, float), np.inf
    for _ in range(CORRECTIONS):
        found = sweep(rod, pressures, moment, loads, elements, tangents=True)
        error = float(np.linalg.norm(found.moment))
        if error <= tolerance:
            if not loads.has_moments and unstable_modes(rod, pressures, moment, loads, elements) > 0:
                return None
            return Equilibrium(moment, found, True)
        if not error < CONTRACTION * before:
            return None
        before = error
        assert found.tangents is not None
        try:
            moment = moment - np.linalg.solve(found.tangents.moment[:, :3], found.moment)
        except np.linalg.LinAlgError:
            return None
    return None


def stiffness(at: Sweep) -> float:
    """Determinant of the moment balance by the base moment: 1 without load, 0 at a critical load."""
    assert at.tangents is not None
    return float(np.linalg.det(at.tangents.moment[:, :3]))


def follow(
    rod: Rod,
    start: Station,
    end: Station,
    base_moment: Array,
    elements: int,
    passed: list[tuple[float, Array]] | None = None,
) -> Followed:
    """Follow stable equilibria along a straight path.

    ``base_moment`` is that of its start [N·mm]; ``passed`` gets the part of the path and the base moment
    of each equilibrium reached.
    """
    scale = max(load_scale(rod, start.loads), load_scale(rod, end.loads))
    moment = np.array(base_moment, float)
    at = sweep(rod, start.pressures, moment, start.loads, elements, tangents=True)
    done, behind, step, least = 0.0, 0.0, FIRST_STEP, 1.0
    slope = bend = np.zeros(3)
    stiff = stiff_before = stiffness(at)
    while done < 1.0:
        goal = min(1.0, done + step)
        pressures = start.pressures + goal * (end.pressures - start.pressures)
        loads = start.loads.towards(end.loads, goal)
        ahead = (goal - done) / (done - behind) if done > 0.0 else 0.0
        if done > 0.0:
            predicted = moment + (goal - done) * (slope + (goal - behind) * bend)
        else:
            # A dead tip force has a moment about the base that follows from the tip.
            predicted = moment + goal * cross(at.tip, end.loads.tip_force - start.loads.tip_force)
        tolerance = tolerance_on_the_way(scale, stiff) if goal < 1.0 else statics_tolerance(scale)
        trial = settle(rod, pressures, predicted, loads, elements, tolerance)
        stiff_there = 0.0 if trial is None else stiffness(trial.sweep)
        away = abs(stiff_there - stiff - ahead * (stiff - stiff_before))
        near = away <= PREDICTED * min(abs(stiff), abs(stiff_there)) or goal - done <= SHORT_STEP * goal
        if trial is not None and done > 0.0:
            larger = max(float(np.linalg.norm(m)) for m in (moment, trial.base_moment))
            corrected = float(np.linalg.norm(trial.base_moment - predicted))
            near = near and corrected <= CORRECTED * larger + ON_THE_WAY * scale
        if trial is not None and near:
            # By divided differences: a parabola through the last three points, first a line through two.
            slope_before, slope = slope, (trial.base_moment - moment) / (goal - done)
            bend = (slope - slope_before) / (goal - behind) if done > 0.0 else bend
            behind, stiff_before, stiff = done, stiff, stiff_there
            moment, done, at = trial.base_moment, goal, trial.sweep
            least = min(least, stiff)
            if passed is not None:
                passed.append((done, moment))
            step *= 2.0
        else:
            step = 0.5 * (goal - done)
            if step < LEAST_STEP * goal + TINY_STEP:
                break
    return Followed(moment, at, done, least)


def equilibrium(rod: Rod, pressures: Array, loads: Loads, elements: int = 3) -> Followed:
    """The equilibrium that the arm reaches when pressures and loads grow together from zero."""
    if loads.is_zero:
        found = newton(rod, pressures, np.zeros(3), loads, elements)
        return Followed(found.base_moment, found.sweep, 1.0)
    rest = Station(np.zeros(rod.pressures), loads.scaled(0.0))
    return follow(rod, rest, Station(np.array(pressures, float), loads), np.zeros(3), elements)


def buckled(rod: Rod, pressures: Array, loads: Loads, end: Followed, elements: int) -> Equilibrium:
    """Some equilibrium under the full load, for an arm whose branch ends before, at ``end``."""
    dead = loads.has_moments or loads.joint_force
    start = end.base_moment if dead else cross(end.sweep.tip, loads.tip_force)
    return newton(rod, pressures, start, loads, elements)


def critical_factor(
    rod: Rod,
    pressures: Array,
    loads: Loads,
    max_factor: float = 1.0,
    elements: int = 3,
) -> float | None:
    """Least factor of the tip force at which the arm loses its stability.

    Args:
        rod: the sections.
        pressures: [bar].
        loads: dead loads; only the tip force is scaled, pressures and the others act in full.
        max_factor: upper end of the search.
        elements: steps per section to begin with; doubled until two verdicts agree, since too few elements
            count unstable modes that finer ones do not have.

    Returns:
        The factor to 0.5 %, 0.0 when the other loads alone suffice, or None when the arm is stable up to
        ``max_factor``.
    """
    p, found = np.array(pressures, float), -1.0
    bare, full = replace(loads, tip_force=np.zeros(3)), replace(loads, tip_force=max_factor * loads.tip_force)
    while True:
        before, found = found, 0.0
        own = equilibrium(rod, p, bare, elements)
        if own.done == 1.0:
            found = follow(rod, Station(p, bare), Station(p, full), own.base_moment, elements).done
            if found == 1.0:
                return None
        if elements >= MAX_ELEMENTS or abs(found - before) <= SAME_FACTOR * found:
            return max_factor * found
        elements *= 2
