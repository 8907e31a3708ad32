"""On which side of its hysteresis loop every axis is, from the history of its commands.

A play operator: the axis follows its command as soon as that has moved by the width of the loop. After a
longer motion the side is -1 (the command fell, the axis is above it) or 1 (it rose), whatever the true width.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.model import Model
from contid.targets import Actuation

#: Half the loop that is assumed, as a part of the range of an axis.
HALF_LOOP: Final = 0.01


class HysteresisSides:
    """The sides of all axes of an arm; 0 before their first motion."""

    def __init__(self, model: Model) -> None:
        self._half: Array = HALF_LOOP * (np.array(model.upper) - np.array(model.lower))
        self._follower: Array | None = None

    def to(self, actuation: Actuation) -> Actuation:
        """Move on to a command [m or Pa]; the sides there, -1 to 1."""
        q = np.array(actuation)
        held = q if self._follower is None else self._follower
        self._follower = np.clip(held, q - self._half, q + self._half)
        sides: list[float] = ((q - self._follower) / self._half).tolist()
        return tuple(sides)
