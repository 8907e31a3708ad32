"""A motion checked from configuration to configuration, without gaps between them.

No point of a body moves further between two configurations than its speed bound allows. A pair that was d
apart is therefore at least d - motion apart, and is not computed again before that falls below the margin.
Between two computed configurations, d1 and d2 apart with a motion m between them, the distance is at least
(d1 + d2 - m)/2; where that is not enough, the motion is halved, down to `RESOLUTION_M`.
"""

from __future__ import annotations

from typing import Final

from contid.clearance.guard import ClearanceGuard, Configuration, Nearest, Shapes
from contid.targets import Actuation, Vec3
from contid.units import m_to_mm

#: Between two configurations whose motion is less than twice this, the margin may be missed by it [m].
RESOLUTION_M: Final = 5e-5
#: Distances are computed up to the margin and this; a pair farther apart needs no exact value [m].
LOOK_AHEAD_M: Final = 0.05


class Walk:
    """Follows the motion of the robots of a guard.

    A pair that is nearer than the margin at the beginning may move as long as it does not come nearer.

    Args:
        guard: what is kept apart.
        start: configuration of every robot of the guard.
    """

    def __init__(self, guard: ClearanceGuard, start: Configuration) -> None:
        self._guard = guard
        self._now = dict(start)
        shapes = Shapes(guard, self._now)
        found = {pair: self._nearest(shapes, pair) for pair in guard.pairs}
        #: Certain lower bound of the distance of each pair now, and what it must not fall below.
        self._bounds = {pair: each.distance.lower_m for pair, each in found.items()}
        self._floors = {pair: min(guard.margin_m, bound) for pair, bound in self._bounds.items()}
        close = [each for each in found.values() if each.distance.lower_m < guard.margin_m]
        #: Why the beginning is too near, "" when it is not.
        self.start_message: str = self._message(close[0]) if close else ""

    @property
    def configuration(self) -> Configuration:
        """The configuration reached."""
        return self._now

    def to(self, goal: Configuration) -> str:
        """Move on to a configuration; why that comes too near, "" when it does not.

        Robots that are not named stay where they are. After a refusal nothing has moved.
        """
        after = self._now | {name: each for name, each in goal.items() if name in self._guard.arms}
        motion = {name: self._motion(name, self._now[name], after[name]) for name in after}
        if not any(motion.values()):
            self._now = after
            return ""
        bounds: dict[tuple[str, str], float] = {}
        begin, end = Shapes(self._guard, self._now), Shapes(self._guard, after)
        for pair in self._guard.pairs:
            moved = sum(motion.get(name, 0.0) for name in pair)
            bounds[pair] = self._bounds[pair] - moved
            if moved == 0.0 or bounds[pair] >= self._floors[pair]:
                continue
            found = self._between(pair, self._now, begin, after, end, moved)
            if found.distance.lower_m < self._floors[pair] - RESOLUTION_M:
                return self._message(found)
            bounds[pair] = found.distance.lower_m
        self._now, self._bounds = after, bounds
        margin = self._guard.margin_m
        self._floors = {pair: min(margin, max(self._floors[pair], bounds[pair])) for pair in bounds}
        return ""

    def _between(
        self,
        pair: tuple[str, str],
        before: Configuration,
        begin: Shapes,
        after: Configuration,
        end: Shapes,
        moved: float,
    ) -> Nearest:
        """The distance at ``after``, or where on the way there the pair is too near."""
        floor = self._floors[pair]
        last = self._nearest(end, pair)
        if last.distance.lower_m < floor or moved <= 2.0 * RESOLUTION_M:
            return last
        first = self._nearest(begin, pair)
        if 0.5 * (first.distance.lower_m + last.distance.lower_m - moved) >= floor - RESOLUTION_M:
            return last
        middle = {name: _halfway(before[name], after[name]) for name in before}
        between = Shapes(self._guard, middle)
        arms = [name for name in pair if name in self._guard.arms]
        first_half = sum(self._motion(name, before[name], middle[name]) for name in arms)
        second_half = sum(self._motion(name, middle[name], after[name]) for name in arms)
        found = self._between(pair, before, begin, middle, between, first_half)
        if found.distance.lower_m < floor - RESOLUTION_M:
            return found
        return self._between(pair, middle, between, after, end, second_half)

    def _nearest(self, shapes: Shapes, pair: tuple[str, str]) -> Nearest:
        return shapes.nearest(pair, self._guard.margin_m + LOOK_AHEAD_M)

    def _motion(self, name: str, before: tuple[Actuation, Vec3], after: tuple[Actuation, Vec3]) -> float:
        # A change of the load is a step of the target: only its end is computed.
        changed = 2.0 * RESOLUTION_M if before[1] != after[1] else 0.0
        return max(self._guard.arms[name].motion_m(before[0], after[0]), changed)

    def _message(self, nearest: Nearest) -> str:
        return f"{nearest}; clearance.margin_mm is {m_to_mm(self._guard.margin_m):g}"


def _halfway(a: tuple[Actuation, Vec3], b: tuple[Actuation, Vec3]) -> tuple[Actuation, Vec3]:
    load = (0.5 * (a[1][0] + b[1][0]), 0.5 * (a[1][1] + b[1][1]), 0.5 * (a[1][2] + b[1][2]))
    return tuple([0.5 * (x + y) for x, y in zip(a[0], b[0], strict=True)]), load
