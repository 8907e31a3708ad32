"""The tips of robots with ``follow_tip_mm``: where the measured axes put them, and where the commands did.

Every axis may be within its own tolerance (`contid.control.engine.watch.body_watch`) while their differences
bend the arm elsewhere. The tip of the model at the measured axes has to stay within ``follow_tip_mm`` of the
way of the tips of the commands, which goes back as far as a healthy axis may be behind; both are without a
load. Axes that lag alike only move the tip back along this way; axes that lag differently bend the arm
elsewhere, and its tip leaves it.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from itertools import pairwise
from typing import Final

from contid.control.engine.cycle import Timing
from contid.control.engine.exchange import Exchange
from contid.control.engine.measured_tip import tip_in_world
from contid.control.engine.robots import Robots
from contid.control.engine.stages import Targets, TickStage
from contid.control.engine.watch.watched_body import CONFIRM_S
from contid.control.tick.faults import Fault
from contid.control.tick.follow.expected_range import OLD_S, AxisResponse
from contid.control.tick.robot_tick import TickResult
from contid.control.tick.supervisor import Mode
from contid.targets import ZERO3, Actuation, Vec3
from contid.units import m_to_mm

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


class WatchedTip:
    """The tip of one robot.

    Attributes:
        config: of the robot.
        path: of the tips of its commands.
    """

    def __init__(self, index: int, robots: Robots) -> None:
        config = robots.configs[index]
        assert config.follow_tip_m is not None
        self._index, self._robots = index, robots
        self.config = config
        self.path = TipPath(config.responses, config.period_s)
        self._tolerance_m = config.follow_tip_m
        self._confirm = max(math.ceil(CONFIRM_S / config.period_s), 2)
        self._outside = 0
        self._known: tuple[Actuation, Vec3 | None] = ((), None)

    def command(self, actuation: Actuation, now_s: float) -> None:
        """Take a command; the tip of one that stands still is known."""
        if actuation != self._known[0]:
            self._known = (actuation, self._tip(actuation, now_s))
        if (tip_m := self._known[1]) is not None:
            self.path.tips.append(tip_m)

    def _tip(self, actuation: Actuation, now_s: float) -> Vec3 | None:
        """The tip without a load; None outside the domain of the model, or where that does not answer."""
        return self._robots.ask(self._index, now_s, tip_in_world, self.config, actuation, ZERO3)

    def rest(self) -> None:
        """No command is to be compared with."""
        self.path.tips.clear()
        self._outside = 0

    def off_m(self, measured: Actuation, now_s: float) -> float:
        """How far the tip is off once that is confirmed [m], else 0."""
        tip_m = self._tip(measured, now_s)
        off_m = 0.0 if tip_m is None else self.path.distance(tip_m)
        self._outside = self._outside + 1 if off_m > self._tolerance_m else max(self._outside - 1, 0)
        return off_m if off_m > self._tolerance_m and self._outside >= self._confirm else 0.0


class TipWatch(TickStage):
    """The tips of all robots that ask for it."""

    def __init__(self, robots: Robots, exchange: Exchange) -> None:
        self._robots = robots
        self._exchange = exchange
        self._tips = {
            index: WatchedTip(index, robots)
            for index, config in enumerate(robots.configs)
            if config.follow_tip_m is not None
        }
        self.robots = tuple(self._tips)

    def before(self, targets: Targets, timing: Timing, now_s: float) -> Targets:
        """See `TickStage.before`: compares the newest measurements."""
        for index, tip in self._tips.items():
            samples = self._exchange.samples_of(tip.config)
            cleared = self._robots.states[index].mode is Mode.READY and tip.config.motion_rules > 5
            if not tip.path.tips or cleared or any(sample.age_s > OLD_S for sample in samples):
                continue
            measured = tip.config.measured_actuation(samples)
            if measured is not None and (off_m := tip.off_m(measured, now_s)):
                message = (
                    f"the tip of the measured axes is {m_to_mm(off_m):.4g} mm off the way of the commanded "
                    "tips: its axes are behind by different amounts"
                )
                self._robots.fail(index, Fault.DOES_NOT_FOLLOW, message, now_s)
        return targets

    def after(self, outcomes: list[TickResult], targets: Targets, now_s: float) -> None:
        """See `TickStage.after`: takes the commands."""
        for index, tip in self._tips.items():
            outcome = outcomes[index]
            state = outcome.state
            # A robot in FAULT has stopped for a reason, and its model may be it.
            if outcome.device and state.enabled and state.squeeze is None and state.mode is not Mode.FAULT:
                tip.command(state.command, now_s)
            else:
                tip.rest()
