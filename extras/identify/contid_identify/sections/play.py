"""Play and dry friction between a command and its axis: what is kept when the command turns back.

    y = max(u - h, min(u + h, y before)),   h = r + m |u|

``u`` is a command about the middle. Prandtl's element, with a half width that grows with the command
(Krasnosel'skii and Pokrovskii, Systems with Hysteresis, 1989): ``r`` is the play of gears and guides, and
tendons lose a share of their tension in what they run over (capstan), so that the tip holds until it is lost.
Nothing depends on how fast a command is.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from contid.kinematics.array import Array


class AxisPlay(NamedTuple):
    """Between every command and its axis.

    Attributes:
        half: half of the play, ``r`` [m or Pa].
        share: of a command about the middle that friction keeps, ``m``.
    """

    half: float
    share: float

    def behind(self, commands: Array) -> Array:
        """What commands about the middle ``(ticks, axes)`` become; the first ones had held before."""
        if self.half <= 0.0 and self.share <= 0.0:
            return commands
        return np.column_stack(
            [played(each, self.half + self.share * np.abs(each), float(each[0])) for each in commands.T]
        )


NO_PLAY: Final = AxisPlay(0.0, 0.0)


def played(values: Array, half: Array | float, begin: float) -> Array:
    """Values ``(ticks,)`` behind a play of half a width, the same or one for each (Prandtl's element)."""
    y, out = begin, []
    for low, high in zip((values - half).tolist(), (values + half).tolist(), strict=True):
        y = max(low, min(high, y))
        out.append(y)
    return np.array(out)
