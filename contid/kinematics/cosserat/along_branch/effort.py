"""How much a search along the branch may do, in the control loop and elsewhere.

Specification of ``contid/kernels/cosserat/along_branch/effort.hpp``.
"""

from __future__ import annotations

from dataclasses import dataclass

from contid.kinematics.cosserat.branch import MAX_ELEMENTS
from contid.kinematics.cosserat.solve import Problem


@dataclass(frozen=True, slots=True)
class Effort:
    """How much a search may do.

    Attributes:
        work: steps of the short descents, for two sections of three elements (`steps_for`).
        sets: starts next to every corner: see `corner_starts`.
        look_elements: of a look at a start.
        longer, long_work: number of longer descents, of the best of these, and steps of each.
        around: whether descents from points around the best of these follow.
        beside: answers on the target that are searched beside: see `Beside`.
        last_work: steps of the last descents (`last_descents`), as ``work``.
        again: most elements with which a search is made again where these lose an answer on the target.
        restarts: of solves without a load, from further points of the box.
    """

    work: int
    sets: int
    look_elements: int
    longer: int
    long_work: int
    around: bool
    beside: int
    last_work: int
    again: int
    restarts: int


#: In the control loop (a few ticks), and elsewhere.
TICK = Effort(
    work=450,
    sets=1,
    look_elements=2,
    longer=1,
    long_work=60,
    around=False,
    beside=0,
    last_work=140,
    again=6,
    restarts=20,
)
THOROUGH = Effort(
    work=2600,
    sets=4,
    look_elements=3,
    longer=12,
    long_work=200,
    around=True,
    beside=2,
    last_work=3000,
    again=MAX_ELEMENTS,
    restarts=100,
)


def steps_for(problem: Problem, cost: int) -> int:
    """How many steps a cost allows, which is in steps of two sections of three elements."""
    return 6 * cost // (problem.elements * len(problem.rod.sections))
