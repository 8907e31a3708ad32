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
pace waits. Everything is a function of recorded samples, so a replay slows in the same ticks.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

from contid.control.engine.cycle import Sink, Timing
from contid.control.engine.events.robots import PathSlowed
from contid.control.engine.robots import Robots
from contid.control.engine.sources import Timed
from contid.control.engine.stages import Targets, TickStage
from contid.control.engine.target_selector import TargetSelector
from contid.control.engine.watch.body_watch import BodyWatch
from contid.control.tick.state import RobotState
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
        self._grace = math.ceil(GRACE_S / self._period_s)
        self._first, self._before = 1.0, 1.0  # the first lag, and the pace of the tick before
        self._behind = self._newest = 0.0
        self._stated: tuple[str, str] | None = None  # robot and axis of the newest event
        self._full = 0  # ticks at full pace since
        self._lost_s = 0.0

    def before(self, targets: Targets, timing: Timing, now_s: float) -> Targets:
        """See `TickStage.before`: slows what moves by the newest comparison."""
        if self._watch.behind < BEGIN and self.pace == 1.0 and self._stated is None:
            self._behind = self._newest = 0.0
            return targets
        source = self._selector.source
        timed = source if isinstance(source, Timed) else None
        states = self._robots.states
        moving = [
            index
            for index, state in enumerate(states)
            if (state.mode is Mode.RUN and timed is not None and state.follow)
            or (state.mode is Mode.APPROACH and isinstance(state.motion, Approach))
        ]
        for index, body in enumerate(self._watch.bodies):
            body.grace = self._grace if index in moving else 0
        worst = max(moving, key=lambda index: self._watch.bodies[index].behind, default=-1)
        behind = self._watch.bodies[worst].behind if moving else 0.0
        self._change(behind, moving)
        if self.pace < 1.0:
            lost = 1.0 - self.pace
            if timed is not None:
                timed.slow(lost)
            for index in moving:
                if (state := states[index]).mode is Mode.APPROACH:
                    later_s = state.motion_s + lost * self._period_s
                    states[index] = replace(state, motion_s=later_s)
            self._lost_s += lost * self._period_s if moving else 0.0
        self._report(worst, timing.tick)
        return targets

    def _change(self, behind: float, moving: list[int]) -> None:
        """The pace of this tick, from the greatest distance outside a range as a share of its tolerance."""
        asked = 1.0
        kept, last = min(behind, self._newest), self._behind  # noise of one reading slows nothing
        if kept > BEGIN:
            rising = max(kept - last, 0.0) / self._period_s
            far = (kept + AHEAD_S * rising - BEGIN) / (1.0 - BEGIN)
            asked = max(1.0 - (1.0 - LEAST) * far, LEAST)
        self._behind, self._newest = kept, behind
        share = self._quickness(moving)
        first = self._first + (asked - self._first) * share
        pace = self.pace + (first - self.pace) * share
        if asked == 1.0 and 1.0 - min(first, pace) < WHOLE:
            first = pace = 1.0
        if all(self._allows(index, pace / self.pace) for index in moving):
            self._before, self._first, self.pace = self.pace, first, pace
        else:
            self._before = self.pace

    def _quickness(self, moving: list[int]) -> float:
        """Share of the way to what is asked for in a tick, for the present speeds along the path."""
        quick = _QUICKEST
        for index in moving:
            config, period_s = self._robots.configs[index], self._period_s * self.pace
            steps = self._robots.states[index].increments
            for step, push, jerk in zip(steps, config.acceleration, config.jerk, strict=True):
                if speed := abs(step) / period_s:
                    quick = min(
                        quick, math.e * _SHARE * push / speed, math.sqrt(_SHARE * jerk / (1.14 * speed))
                    )
        return 1.0 - math.exp(-quick * self._period_s)

    def _allows(self, index: int, ratio: float) -> bool:
        """True when the axes of a robot may change their speed by a ratio, besides what the path needs."""
        state: RobotState = self._robots.states[index]
        had = self.pace / self._before
        for step, was, limit in zip(
            state.increments,
            state.before or state.increments,
            self._robots.configs[index].limits,
            strict=True,
        ):
            by_path = step - was * had
            change = abs(by_path + step * (ratio - 1.0))
            if change > limit.change and change > abs(by_path):
                return False
        return True

    def _report(self, worst: int, tick: int) -> None:
        """One event when a body slows its path, and one when it follows again."""
        self._full = self._full + 1 if self.pace == 1.0 else 0
        if self._stated is None and self.pace < STATED and worst >= 0:
            body = self._watch.bodies[worst]
            axis, text = body.behind_axis()
            self._stated = (body.config.name, axis)
            self._sink.event(
                PathSlowed(
                    tick=tick, robot=body.config.name, axis=axis, over=False, lost_s=0.0,
                    message=f"{text}, behind by more than its device explains: the path is slowed",
                )
            )  # fmt: skip
        elif self._stated is not None and self._full * self._period_s >= OVER_S:
            robot, axis = self._stated
            lost_s, self._lost_s, self._stated = round(self._lost_s, 3), 0.0, None
            self._sink.event(
                PathSlowed(
                    tick=tick, robot=robot, axis=axis, over=True, lost_s=lost_s,
                    message=f"{axis} follows again; the path took {lost_s:.2g} s longer",
                )
            )  # fmt: skip
        elif self._stated is None and self.pace == 1.0:
            self._lost_s = 0.0
