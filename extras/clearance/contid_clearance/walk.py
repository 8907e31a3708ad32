"""A motion checked from configuration to configuration, without gaps between them.

No point of a body moves further between two configurations than its speed bound allows. A pair that was d
apart is therefore at least d - motion apart, and is not computed again before that falls below the margin. Of
a body and itself the motion is that of its points towards each other (`contid_clearance.arm.BodySpeeds`).
Between two computed configurations, d1 and d2 apart with a motion m between them, the distance is at least
(d1 + d2 - m)/2; where that is not enough, the motion is halved, down to `RESOLUTION_M`.

Motions are only added up until a robot has moved half of what the nearest pair had to spare: in most ticks
that is all there is to do.

Tips that may touch and a body with itself are sampled along a motion instead, and at the end of a stop: they
are near for as long as something is held, and what has crossed stays so.

A robot in motion also needs room to stop: `Walk.stops` follows the stops of all robots from where they are.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final, TypeAlias

from contid.control.tick.preflight.kept_apart import Configuration
from contid.targets import Actuation, Vec3, vec3
from contid.trajectory.straight_stop import StraightStop
from contid_clearance.arm import NO_MOTION, Motion
from contid_clearance.guard import LOOK_AHEAD_M, ClearanceGuard, Nearest, Pair, Shapes

#: A motion shorter than twice this is not halved; in it a pair may be this much nearer than the margin [m].
RESOLUTION_M: Final = 5e-5
#: The motion of a pair that stops is halved at most this often. A pair that is not shown to be far enough
#: apart by then counts as too near.
MAX_HALVINGS: Final = 32
#: Pairs that are sampled are computed at points of a motion that are at most this far apart by the bound [m].
SAMPLED_M: Final = 1e-2

#: By robot.
Motions: TypeAlias = Mapping[str, Motion]


class Walk:
    """Follows the motion of the robots of a guard.

    A pair that is nearer than the margin at the beginning may move as long as it does not come nearer.

    Args:
        guard: what is kept apart.
        start: configuration of every robot of the guard.
    """

    def __init__(self, guard: ClearanceGuard, start: Configuration) -> None:
        self._guard = guard
        #: The pair of the newest refusal.
        self.refused: Pair = ("", "")
        self.place(start)

    @property
    def configuration(self) -> Configuration:
        """The configuration reached."""
        return self._now

    def place(self, configuration: Configuration) -> list[Nearest]:
        """Set the configuration of every robot without a check; returns the distances there."""
        self._now = dict(configuration)
        self._shapes = shapes = Shapes(self._guard, self._now)
        nearest = {pair: self._nearest(shapes, pair) for pair in self._guard.pairs}
        #: Lower bound of what each pair has to spare at present, and what it must keep of that [m].
        self._bounds = {pair: each.spare_m for pair, each in nearest.items()}
        self._floors = {pair: min(0.0, bound) for pair, bound in self._bounds.items()}
        near = {pair: shapes.sampled(pair) for pair in self._guard.sampled}
        #: The same of the pairs that are sampled.
        self._near_bounds = {pair: each.spare_m for pair, each in near.items()}
        self._near_floors = {pair: min(0.0, bound) for pair, bound in self._near_bounds.items()}
        self._add_up_anew()
        return [*nearest.values(), *near.values()]

    def copy(self) -> Walk:
        """A walk from the same configuration."""
        other = object.__new__(Walk)
        bounds = {"_bounds": dict(self._bounds), "_near_bounds": dict(self._near_bounds)}
        other.__dict__.update(self.__dict__ | bounds)
        return other

    def _add_up_anew(self) -> None:
        #: Motion of each robot that is not taken off the bounds yet.
        self._moved = dict.fromkeys(self._guard.arms, NO_MOTION)
        sides = ((self._bounds, self._floors), (self._near_bounds, self._near_floors))
        left = [(pair, x - floors[pair]) for all_, floors in sides for pair, x in all_.items()]
        #: What the pair of two with the least to spare has left above its floor by its bound [m], and what
        #: the body that is nearest to itself has.
        self._left_m = min([x for (one, other), x in left if one != other], default=math.inf)
        self._own_left_m = min([x for (one, other), x in left if one == other], default=math.inf)

    def _moved_with(self, motions: Motions) -> dict[str, Motion] | None:
        """The motions with further ones added; None where a pair may be too near then."""
        moved, way_m, change_m = dict(self._moved), 0.0, 0.0
        for name, before in moved.items():
            if (more := motions.get(name)) is not None:
                before = moved[name] = Motion(before.way_m + more.way_m, before.change_m + more.change_m)
            way_m, change_m = max(way_m, before.way_m), max(change_m, before.change_m)
        return moved if 2.0 * way_m <= self._left_m and change_m <= self._own_left_m else None

    def _settle(self) -> None:
        """Take the motions that were added up off the bounds."""
        if any(map(any, self._moved.values())):
            self._bounds, self._near_bounds = (
                {pair: bound - _nearer_m(pair, self._moved) for pair, bound in bounds.items()}
                for bounds in (self._bounds, self._near_bounds)
            )
            self._add_up_anew()

    def has_room(self, motions: Motions) -> bool:
        """True when no pair can come too near by motions of at most these lengths, by robot."""
        if self._moved_with(motions) is not None:
            return True
        self._settle()
        return all(
            self._has_room(pair, _nearer_m(pair, motions), floors[pair], sampled)
            for floors, sampled in ((self._floors, False), (self._near_floors, True))
            for pair in floors
        )

    def _has_room(self, pair: Pair, nearer_m: float, floor_m: float, sampled: bool) -> bool:
        """True when a pair may come nearer by a way; it is computed anew where its bound does not show it."""
        bounds, as_before = self._near_bounds if sampled else self._bounds, self._guard.asks_as_before
        if nearer_m == 0.0 or bounds[pair] - nearer_m >= floor_m:
            return True
        if sampled and as_before:
            return False
        enough_m = floor_m + nearer_m if as_before else max(floor_m + nearer_m, LOOK_AHEAD_M)
        here = self._shapes.sampled(pair) if sampled else self._shapes.nearest(pair, enough_m)
        bounds[pair] = max(bounds[pair], here.spare_m)
        if not as_before:
            self._add_up_anew()
        return here.spare_m - nearer_m >= floor_m

    def to(self, goal: Configuration) -> str:
        """Move on to a configuration; returns why that comes too near, or "".

        Robots that ``goal`` does not name stay where they are. After a refusal nothing has moved.
        """
        goal = {name: each for name, each in goal.items() if name in self._guard.arms}
        after = {**self._now, **goal}
        motions = {name: self._motion(name, self._now[name], each) for name, each in goal.items()}
        moved = self._moved_with(motions)
        if moved is not None or not any(map(any, motions.values())):
            self._now, self._shapes = after, Shapes(self._guard, after)
            self._moved = self._moved if moved is None else moved
            return ""
        self._settle()
        bounds: dict[tuple[str, str], float] = {}
        begin, end = self._shapes, Shapes(self._guard, after)
        for pair in self._guard.pairs:
            nearer_m = _nearer_m(pair, motions)
            bounds[pair] = self._bounds[pair] - nearer_m
            if nearer_m == 0.0 or bounds[pair] >= self._floors[pair]:
                continue
            found = self._between(pair, self._now, begin, after, end, nearer_m)
            if found.spare_m < self._floors[pair] - RESOLUTION_M:
                self.refused = pair
                return str(found)
            bounds[pair] = found.spare_m
        near, found_near = self._sampled(after, end, motions)
        if found_near is not None:
            self.refused = found_near.robot, found_near.other
            return str(found_near)
        self._now, self._shapes, self._bounds, self._near_bounds = after, end, bounds, near
        self._floors = {pair: min(0.0, max(self._floors[pair], bounds[pair])) for pair in bounds}
        self._near_floors = {pair: min(0.0, max(self._near_floors[pair], near[pair])) for pair in near}
        self._add_up_anew()
        return ""

    def _sampled(
        self, after: Configuration, end: Shapes, motions: Motions
    ) -> tuple[dict[Pair, float], Nearest | None]:
        """New bounds of the pairs that are sampled, and the one that comes too near."""
        bounds: dict[Pair, float] = {}
        for pair in self._guard.sampled:
            nearer_m = _nearer_m(pair, motions)
            bounds[pair] = self._near_bounds[pair] - nearer_m
            if nearer_m == 0.0 or bounds[pair] >= self._near_floors[pair]:
                continue
            # A crossing stays until the tips are drawn back: between near points none is missed.
            way_m = sum([motions.get(name, NO_MOTION).way_m for name in pair])
            parts = max(math.ceil(way_m / SAMPLED_M), 1)
            for k in range(1, parts + 1):
                shapes = end if k == parts else Shapes(self._guard, _between(self._now, after, k / parts))
                found = shapes.sampled(pair)
                if found.spare_m < self._near_floors[pair] - RESOLUTION_M:
                    return bounds, found
                bounds[pair] = found.spare_m
        return bounds, None

    def stops(self, stops: Mapping[str, StraightStop], tolerance_m: float = 0.0) -> str:
        """Why robots that begin to stop now would come too near, or ""; the configuration stays.

        Args:
            stops: the stop of every robot in motion.
            tolerance_m: a pair may be this much nearer than it must otherwise be.
        """
        motions = {name: self._guard.arms[name].motion(stop.distances) for name, stop in stops.items()}
        if self._moved_with(motions) is not None:
            return ""
        self._settle()
        times = {0.0: self._shapes}
        for pair in self._guard.pairs:
            floor_m = self._floors[pair] - tolerance_m
            if self._has_room(pair, _nearer_m(pair, motions), floor_m, False):
                continue
            own = {name: stops[name] for name in pair if name in stops}
            found = self._stopping(pair, own, times, stops, floor_m)
            if found is not None:
                self.refused = pair
                return f"before it can stop, {found}"
        for pair in self._guard.sampled:
            floor_m = self._near_floors[pair] - tolerance_m
            if self._has_room(pair, _nearer_m(pair, motions), floor_m, True):
                continue
            end_s = max(stops[name].duration_s for name in pair if name in stops)
            near = self._ahead(times, end_s, stops).sampled(pair)
            if near.spare_m < floor_m:
                self.refused = pair
                return f"before it can stop, {near}"
        return ""

    def _stopping(
        self,
        pair: Pair,
        own: Mapping[str, StraightStop],
        times: dict[float, Shapes],
        stops: Mapping[str, StraightStop],
        floor_m: float,
    ) -> Nearest | None:
        """Find where a pair comes too near while it stops; None when it does not.

        ``own`` are the stops of the pair, ``stops`` those of all robots; ``times`` keeps their shapes.
        """
        enough_m = floor_m + LOOK_AHEAD_M
        parts = [(0.0, max(stop.duration_s for stop in own.values()))]
        halvings = 0
        while parts:
            begin_s, end_s = parts.pop()
            begin = self._ahead(times, begin_s, stops).nearest(pair, enough_m)
            end = self._ahead(times, end_s, stops).nearest(pair, enough_m)
            if end.spare_m < floor_m:
                return end
            moved = sum(
                self._guard.arms[name].motion_m(own[name].at(begin_s).position, own[name].at(end_s).position)
                for name in pair
                if name in own
            )
            if moved <= 2.0 * RESOLUTION_M:
                continue
            if 0.5 * (begin.spare_m + end.spare_m - moved) >= floor_m - RESOLUTION_M:
                continue
            halvings += 1
            if halvings > MAX_HALVINGS:
                return end
            middle_s = 0.5 * (begin_s + end_s)
            parts += [(middle_s, end_s), (begin_s, middle_s)]
        return None

    def _ahead(self, times: dict[float, Shapes], time_s: float, stops: Mapping[str, StraightStop]) -> Shapes:
        """The shapes a time after the stops began."""
        if time_s not in times:
            moved = {name: (stop.at(time_s)[0], self._now[name][1]) for name, stop in stops.items()}
            times[time_s] = Shapes(self._guard, self._now | moved)
        return times[time_s]

    def _between(
        self,
        pair: tuple[str, str],
        before: Configuration,
        begin: Shapes,
        after: Configuration,
        end: Shapes,
        nearer_m: float,
    ) -> Nearest:
        """The distance at ``after``, or where on the way there the pair is too near."""
        floor = self._floors[pair]
        last = self._nearest(end, pair)
        if last.spare_m < floor or nearer_m <= 2.0 * RESOLUTION_M:
            return last
        first = self._nearest(begin, pair)
        if 0.5 * (first.spare_m + last.spare_m - nearer_m) >= floor - RESOLUTION_M:
            return last
        middle = _between(before, after, 0.5)
        between = Shapes(self._guard, middle)
        arms = [name for name in pair if name in self._guard.arms]
        first_half = sum(self._motion(name, before[name], middle[name]).way_m for name in arms)
        second_half = sum(self._motion(name, middle[name], after[name]).way_m for name in arms)
        found = self._between(pair, before, begin, middle, between, first_half)
        if found.spare_m < floor - RESOLUTION_M:
            return found
        return self._between(pair, middle, between, after, end, second_half)

    def _nearest(self, shapes: Shapes, pair: tuple[str, str]) -> Nearest:
        return shapes.nearest(pair, LOOK_AHEAD_M)

    def _motion(self, name: str, before: tuple[Actuation, Vec3], after: tuple[Actuation, Vec3]) -> Motion:
        motion = self._guard.arms[name].motion([abs(b - a) for a, b in zip(before[0], after[0], strict=True)])
        if before[1] == after[1]:
            return motion
        # A change of the known load (``[1]``) is a step of the target: only its end is computed.
        return Motion(max(motion.way_m, 2.0 * RESOLUTION_M), max(motion.change_m, 4.0 * RESOLUTION_M))


def _nearer_m(pair: Pair, motions: Motions) -> float:
    """How much nearer a pair comes at most by the motions of robots [m]."""
    one, other = (motions.get(name, NO_MOTION) for name in pair)
    return one.change_m if pair[0] == pair[1] else one.way_m + other.way_m


def _between(before: Configuration, after: Configuration, share: float) -> Configuration:
    """The configuration at a part of a straight way."""

    def mixed(a: Sequence[float], b: Sequence[float]) -> list[float]:
        return [(1.0 - share) * x + share * y for x, y in zip(a, b, strict=True)]

    return {
        name: (tuple(mixed(a, after[name][0])), vec3(mixed(load, after[name][1])))
        for name, (a, load) in before.items()
    }
