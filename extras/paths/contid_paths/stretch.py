"""The least uniform slowdown with which robots can follow a trajectory.

The path stays: only times change. The limits of velocity and acceleration give a first factor (a path that is
s times slower needs s times less speed and s^2 times less acceleration); the check of a run decides, and a
bisection between a factor that it refuses and one that it accepts ends within `ACCURACY`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from contid.control.tick.preflight.rows import Preflight, TooFastError
from contid.trajectory.timed import Trajectory

#: Greatest ratio of the factor found to the least possible one.
ACCURACY: Final = 1.01
#: No trajectory is slowed down further.
MAX_SLOWDOWN: Final = 1e4


def least_stretch(
    trajectory: Trajectory, preflight: Preflight, refused: TooFastError, cancelled: Callable[[], None]
) -> float:
    """The factor of the least uniform slowdown of a trajectory.

    Args:
        trajectory: within reach, but too fast.
        preflight: the check of the run.
        refused: what it raised.
        cancelled: raises when the search has to end.

    Raises:
        BadInputError: no slowdown helps: an axis would have to jump.
    """
    name = refused.findings[0].file

    def followed(factor: float) -> bool:
        cancelled()
        return preflight.follows(trajectory.stretched(factor), name)

    too_fast, enough = 1.0, refused.slowdown * (1.0 + 1e-6)
    while not followed(enough):
        too_fast, enough = enough, 1.5 * enough
        if enough > MAX_SLOWDOWN:
            raise refused
    while enough > ACCURACY * too_fast:
        between = math.sqrt(too_fast * enough)
        too_fast, enough = (too_fast, between) if followed(between) else (between, enough)
    return enough
