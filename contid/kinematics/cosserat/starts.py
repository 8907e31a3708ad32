"""Where searches start: the closed form of the unloaded arm, the centre, Halton points of the box."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.closed_form import (
    mid_and_tip_pressures,
    tip_and_direction_pressures,
    tip_pressures,
)
from contid.kinematics.cosserat.loads import Loads
from contid.kinematics.cosserat.section import Rod
from contid.kinematics.cosserat.solve import Limits
from contid.kinematics.cosserat.spatial import cross
from contid.kinematics.cosserat.task import Task
from contid.kinematics.halton import PRIMES, radical_inverse


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


def starts(limits: Limits, restarts: int) -> Iterator[Array]:
    """The centre, then Halton points of the box [bar], shape (3k,) each."""
    yield limits.centre
    for index in range(1, restarts + 1):
        share = np.array([radical_inverse(index, PRIMES[axis]) for axis in range(len(limits.lower))])
        yield limits.lower + share * (limits.upper - limits.lower)
