"""The way of the tip of a robot's newest commands, and how far a tip is from it.

Axes that lag alike only move the tip back along this way; axes that lag differently bend the arm elsewhere,
and its tip leaves it.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from itertools import pairwise
from typing import Final

from contid.control.tick.follow.expected_range import AxisResponse
from contid.targets import Vec3

#: Lags that the way goes back; the rest of a motion is 5 %.
_LOOK_BACK: Final = 3.0


class TipPath:
    """The tips of the commands of as many ticks as a healthy axis may be behind.

    Attributes:
        tips: of the newest commands [m], the newest last.
    """

    def __init__(self, responses: Sequence[AxisResponse], period_s: float) -> None:
        behind_s = max(each.delay_s + _LOOK_BACK * each.lag_s for each in responses)
        self.tips: deque[Vec3] = deque(maxlen=math.ceil(behind_s / period_s) + 2)

    def distance(self, tip_m: Vec3) -> float:
        """Least distance of a tip from the way [m]; 0 before the first command."""
        if len(self.tips) < 2:
            return math.dist(tip_m, self.tips[0]) if self.tips else 0.0
        return min(_from_line(tip_m, start, end) for start, end in pairwise(self.tips))


def _from_line(point: Vec3, start: Vec3, end: Vec3) -> float:
    """Distance of a point from a straight line between two others, ends included."""
    way = [b - a for a, b in zip(start, end, strict=True)]
    length2 = sum(each * each for each in way)
    along = sum((p - a) * w for p, a, w in zip(point, start, way, strict=True))
    share = min(max(along / length2, 0.0), 1.0) if length2 > 0.0 else 0.0
    return math.dist(point, [a + share * w for a, w in zip(start, way, strict=True)])
