"""The path is slowed where a body is behind by more than its devices explain, before that is a fault.

From two fifths of its tolerance outside its range on (`contid.control.tick.follow.expected_range`), an axis
slows the clock of the trajectory, and of every motion to a target, down to a fifth at its tolerance. So
robots stay on their path and with each other, and a path that is too fast for a body goes at the speed of
that body. One that goes along has `GRACE_S` beyond its tolerance, up to twice of it, until the path is
slow; one that does not is a fault as without this stage. A live stream is not slowed: its rows have the time
of whoever sends them.

The pace follows what is asked of it by two equal lags, for which half of the acceleration and of the jerk of
every axis is enough at its present speed: a step from 0 to 1 by ``k t exp(-k t)`` has slopes of at most
``k / e``, and changes of the slope of at most ``1.14 k^2``. Where the path itself needs the acceleration, the
pace has what is left, and its slope changes within half of the jerk, so an axis has at most one and a half of
its jerk. A motion that begins meanwhile is planned by the slow clock (`RobotState.path_paces`). By motion
rules before 6 the pace waits at once, and motions begin at full pace, up to eight times the jerk. Everything
is a function of recorded samples, so a replay slows in the same ticks.

One event has the robot and axis that slow the path, once the pace is below `STATED`; one follows when the
pace was 1 for `OVER_S`. Until then no other axis is named, and the time lost is added up.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Final, NamedTuple

from contid.control.engine.cycle import Sink, Timing
from contid.control.engine.events.robots import PathSlowed
from contid.control.engine.robots import Robots
from contid.control.engine.sources import Timed
from contid.control.engine.stages import Targets, TickStage
from contid.control.engine.target_selector import TargetSelector
from contid.control.engine.watch.body_watch import BodyWatch
from contid.control.engine.watch.watched_body import WatchedBody
from contid.control.tick.state import FULL_PACE, RobotState
from contid.control.tick.supervisor import Mode
from contid.trajectory.approach import Approach

#: Share of the tolerance outside the range from which on an axis slows the path.
BEGIN: Final = 0.4
#: Pace at the whole tolerance, and least pace.
LEAST: Final = 0.2
#: How far ahead the way of an axis out of its range is looked at [s].
AHEAD_S: Final = 0.1
#: How long an axis that goes along may be beyond its tolerance, until the path is slow [s].
GRACE_S: Final = 0.15
#: A pace nearer to 1 is 1, and one below `STATED` is stated.
WHOLE: Final = 1e-4
STATED: Final = 0.95
#: At full pace for this long, the body follows again [s].
OVER_S: Final = 1.0
#: Share of acceleration and jerk that changes of the pace may use, and how quick they are at most [1/s].
_SHARE: Final = 0.5
_QUICKEST: Final = 50.0


class _Change(NamedTuple):
    """The speed of an axis on a path, and how it changed [m, Pa or rad, in ticks].

    Attributes:
        step: in the last tick.
        by_path: its change that the path needed; that of the pace is none of the path.
        most, most_jolt: greatest change in a tick, and greatest change of the change.
    """

    step: float
    by_path: float
    most: float
    most_jolt: float


class PathPace(TickStage):
    """The pace of everything that follows a path.

    Attributes:
        pace: 1 at the speed of the path.
    """

    def __init__(self, robots: Robots, body_watch: BodyWatch, selector: TargetSelector, sink: Sink) -> None:
        self.robots = range(len(robots.configs))
        self.pace = 1.0
        self._robots, self._watch, self._selector, self._sink = robots, body_watch, selector, sink
        self._period_s = robots.configs[0].period_s if robots.configs else 1.0
        self._plans_at_pace = any(config.motion_rules > 5 for config in robots.configs)
        self._grace = math.ceil(GRACE_S / self._period_s)
        self._first_lag = 1.0  # what is asked for behind one of the two lags; `pace` is behind both
        self._pace_before = 1.0  # in the tick before
        self._behind = self._newest = 0.0  # the smaller of the two newest distances, and the newest
        self._named: tuple[str, str] | None = None  # robot and axis of an event whose end has none yet
        self._full_ticks = 0  # at full pace since
        self._lost_s = 0.0

    def before(self, targets: Targets, timing: Timing, now_s: float) -> Targets:
        """See `TickStage.before`: slows what moves by the newest comparison."""
        quiet = self._watch.behind < BEGIN and self.pace == 1.0 and self._named is None
        if quiet and self._robots.states[0].path_paces == FULL_PACE:
            self._behind = self._newest = 0.0
            return targets
        source = self._selector.source
        timed = source if isinstance(source, Timed) else None
        moving = [
            index
            for index, state in enumerate(self._robots.states)
            if _on_path(state, timed) or (self._plans_at_pace and _begins(state))
        ]
        for index, body in enumerate(self._watch.bodies):
            body.grace = self._grace if index in moving else 0
        worst = max(
            (self._watch.bodies[index] for index in moving), key=lambda body: body.behind, default=None
        )
        self._change(0.0 if worst is None else worst.behind, moving)
        if self.pace < 1.0:
            self._delay(timed, moving)
        self._state_paces()
        self._report(worst, timing.tick)
        return targets

    def _state_paces(self) -> None:
        """Let motions that begin in this tick know the pace at which they are played (motion rules 6)."""
        if self._plans_at_pace:
            for index, state in enumerate(self._robots.states):
                self._robots.states[index] = replace(state, path_paces=(self.pace, *state.path_paces[:2]))

    def _delay(self, timed: Timed | None, moving: list[int]) -> None:
        """Let the clocks of the trajectory and of the motions of this tick be later."""
        lost, states = 1.0 - self.pace, self._robots.states
        if timed is not None:
            timed.slow(lost)
        for index in moving:
            if states[index].mode is Mode.APPROACH:
                later_s = states[index].motion_s + lost * self._period_s
                states[index] = replace(states[index], motion_s=later_s)
        self._lost_s += lost * self._period_s if moving else 0.0

    def _change(self, behind: float, moving: list[int]) -> None:
        """The pace of this tick, from the greatest distance outside a range as a share of its tolerance."""
        confirmed = min(behind, self._newest)  # noise of one reading slows nothing
        asked = self._asked(confirmed, max(confirmed - self._behind, 0.0) / self._period_s)
        self._behind, self._newest = confirmed, behind
        share = self._quickness(moving)
        first = self._first_lag + (asked - self._first_lag) * share
        pace = self.pace + (first - self.pace) * share
        if asked == 1.0 and 1.0 - min(first, pace) < WHOLE:
            first = pace = 1.0
        before, self._pace_before = self._pace_before, self.pace
        if self._plans_at_pace:
            last, sought = self.pace / before - 1.0, pace / self.pace - 1.0
            change = self._smooth(moving, last, sought)
            part = 1.0 if sought == 0.0 else min(max(change / sought, 0.0), 1.0)
            self._first_lag += part * (first - self._first_lag)
            self.pace = min(self.pace * (1.0 + change), 1.0)
        elif self._allows(moving, self.pace / before, pace / self.pace):
            self._first_lag, self.pace = first, pace

    def _asked(self, behind: float, rising_per_s: float) -> float:
        """The pace that is asked for, by how far an axis is behind and how fast that grows."""
        if behind <= BEGIN:
            return 1.0
        far = (behind + AHEAD_S * rising_per_s - BEGIN) / (1.0 - BEGIN)
        return max(1.0 - (1.0 - LEAST) * far, LEAST)

    def _quickness(self, moving: list[int]) -> float:
        """Share of the way to what is asked for in a tick, for the present speeds along the path."""
        quick = _QUICKEST
        for index in moving:
            config, period_s = self._robots.configs[index], self._period_s * self.pace
            steps = self._robots.states[index].increments
            for step, push, jerk in zip(steps, config.acceleration, config.jerk, strict=True):
                if speed := abs(step) / period_s:
                    by_push = math.e * _SHARE * push / speed
                    quick = min(quick, by_push, math.sqrt(_SHARE * jerk / (1.14 * speed)))
        return 1.0 - math.exp(-quick * self._period_s)

    def _changes(self, moving: list[int], last_ratio: float) -> Iterator[_Change]:
        """How every axis on a path changed its speed; ``last_ratio``: the last change of the pace."""
        for index in moving:
            state, config = self._robots.states[index], self._robots.configs[index]
            befores = state.before or state.increments
            rows = zip(state.increments, befores, config.limits, config.jerk, strict=True)
            for step, was, limit, jerk in rows:
                yield _Change(step, step - was * last_ratio, limit.change, jerk * self._period_s**3)

    def _allows(self, moving: list[int], last_ratio: float, ratio: float) -> bool:
        """True when all axes may change their speed by a ratio, besides what the path needs."""
        for axis in self._changes(moving, last_ratio):
            change = abs(axis.by_path + axis.step * (ratio - 1.0))
            if change > axis.most and change > abs(axis.by_path):
                return False
        return True

    def _smooth(self, moving: list[int], last: float, sought: float) -> float:
        """The change of the pace that the axes can follow, next to the one that is sought.

        All are shares of the pace, ``last`` that of the tick before. Changes of it use half of the jerk; the
        acceleration that the path itself leaves is all used, and comes first.
        """
        least, most = -math.inf, math.inf
        for step, by_path, most_change, most_jolt in self._changes(moving, 1.0 + last):
            if step == 0.0:
                continue
            by_jerk = _SHARE * most_jolt / abs(step)
            sought = min(max(sought, last - by_jerk), last + by_jerk)
            room = max(most_change, abs(by_path))
            ends = (-room - by_path) / step, (room - by_path) / step
            least, most = max(least, min(ends)), min(most, max(ends))
        return min(max(sought, least), most)

    def _report(self, worst: WatchedBody | None, tick: int) -> None:
        """One event when a body slows its path, and one when it follows again."""
        self._full_ticks = self._full_ticks + 1 if self.pace == 1.0 else 0
        if self._named is None:
            if self.pace == 1.0:
                self._lost_s = 0.0
            elif self.pace < STATED and worst is not None:
                axis, text = worst.behind_axis()
                self._named = (worst.config.name, axis)
                message = f"{text}, behind by more than its device explains: the path is slowed"
                self._emit(tick, over=False, lost_s=0.0, message=message)
        elif self._full_ticks * self._period_s >= OVER_S:
            lost_s, self._lost_s = round(self._lost_s, 3), 0.0
            message = f"{self._named[1]} follows again; the path took {lost_s:.2g} s longer"
            self._emit(tick, over=True, lost_s=lost_s, message=message)
            self._named = None

    def _emit(self, tick: int, *, over: bool, lost_s: float, message: str) -> None:
        assert self._named is not None
        robot, axis = self._named
        self._sink.event(
            PathSlowed(tick=tick, robot=robot, axis=axis, over=over, lost_s=lost_s, message=message)
        )


def _on_path(state: RobotState, timed: Timed | None) -> bool:
    """True for a robot that follows a trajectory, or a motion to a target."""
    if state.mode is Mode.RUN:
        return timed is not None and state.follow
    return state.mode is Mode.APPROACH and isinstance(state.motion, Approach)


def _begins(state: RobotState) -> bool:
    """True for a robot whose motion to a target begins in this tick, perhaps amid another."""
    return state.mode is Mode.HOLD and state.goto is not None
