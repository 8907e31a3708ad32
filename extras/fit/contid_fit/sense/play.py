"""On which side of its hysteresis loop every axis is, from the history of its commands.

A play operator: the axis follows its command as soon as that has moved by the width of the loop. After a
longer motion the side is -1 (the command fell, the axis is above it) or 1 (it rose), whatever the true width.
Where in its loop an axis begins is not known: until it has gone through it, its side is NaN.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.model import Model
from contid.targets import Actuation

#: Half the loop that is assumed, as a part of the range of an axis.
HALF_LOOP: Final = 0.01
#: From this absolute value of its side on, an axis counts as on a branch of its loop.
ON_BRANCH: Final = 0.999


class HysteresisSides:
    """The sides of all axes of an arm; NaN before an axis has gone through its loop."""

    def __init__(self, model: Model) -> None:
        self._half: Array = HALF_LOOP * (np.array(model.upper) - np.array(model.lower))
        self._follower: Array | None = None
        self._known = np.zeros(len(self._half), dtype=bool)

    def to(self, actuation: Actuation) -> Actuation:
        """Move on to a command [m or Pa]; the sides there, -1 to 1, or `math.nan` itself."""
        q = np.array(actuation)
        held = q if self._follower is None else self._follower
        self._follower = np.clip(held, q - self._half, q + self._half)
        sides = (q - self._follower) / self._half
        self._known |= np.abs(sides) > ON_BRANCH
        known: list[bool] = self._known.tolist()
        return tuple([side if seen else math.nan for side, seen in zip(sides.tolist(), known, strict=True)])
