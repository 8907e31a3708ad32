"""The body is watched: what the axes measure is compared with what their commands should have made of them.

The commands of a tick move the range in which every healthy axis must be
(`contid.control.tick.follow.expected_range`); the measurements that the next tick begins with are compared
with it. One that stays outside by more than its tolerance for 20 ms is a fault: "moves unasked" where
the command stood still, "does not follow" otherwise. A jump that no body is capable of, and a measurement
from the future, are faults at once.

An axis that measures its own command within the tolerance is in its range, whatever that is, unless a least
lag is known: so the range is computed only while some axis of the robot is farther off, and half a second
after that.

A device that yields to what it pushes on may be anywhere while its effort is towards its command and at least
`contid.control.tick.follow.responses.PUSHING` of its limit. A robot whose tip closes on an object is not
compared, nor one whose fault was cleared: its last command is that of before the fault.
Everything is a function of commands and recorded samples, so a replay decides the same.
"""

from __future__ import annotations

from contid.control.engine.cycle import Timing
from contid.control.engine.exchange import Exchange
from contid.control.engine.robots import Robots
from contid.control.engine.stages import Targets, TickStage
from contid.control.engine.watch.settling import AxisPlace, Settling
from contid.control.engine.watch.watched_body import FUTURE_S, WatchedBody
from contid.control.tick.robot_tick import TickResult
from contid.control.tick.state import Effect
from contid.control.tick.supervisor import Mode


class BodyWatch(TickStage):
    """The bodies of all robots.

    Attributes:
        bodies, settlings: by index of the robot.
        behind: greatest distance of a measurement of this tick from its range, as a share of its tolerance.
    """

    def __init__(self, robots: Robots, exchange: Exchange) -> None:
        self.robots = range(len(robots.configs))
        self._robots = robots
        self._exchange = exchange
        self._skipped = 0
        self.behind = 0.0
        self.bodies = [WatchedBody(config) for config in robots.configs]
        self.settlings = [Settling(body) for body in self.bodies]

    def before(self, targets: Targets, timing: Timing, now_s: float) -> Targets:
        """See `TickStage.before`: compares the newest measurements."""
        samples = self._exchange.samples
        latest_s = timing.deadline_s + timing.lateness_s + FUTURE_S
        gap, self._skipped = timing.skipped != self._skipped, timing.skipped
        self.behind = 0.0
        states = self._robots.states
        for index, body in enumerate(self.bodies):
            cleared = states[index].mode is Mode.READY and body.config.motion_rules > 5
            if not body.device or cleared:
                continue
            try:
                for (axis, tolerance), goal in zip(body.near, body.device, strict=True):
                    sample = samples[axis]
                    # None is a TypeError, which costs nothing while there are values.
                    off = sample.value - goal  # type: ignore[operator]
                    if not -tolerance <= off <= tolerance or sample.time_s > latest_s:
                        break
                else:
                    if body.awake:
                        body.rest()
                    continue
            except TypeError:  # an axis has no value
                pass
            body.effort_share = self._exchange.effort_shares.get(body.config.name, 1.0)
            deviation = body.compare(self._exchange.samples_of(body.config), latest_s, gap)
            self.behind = max(self.behind, body.behind)
            if deviation is not None:
                self._robots.fail(index, deviation.fault, deviation.message, now_s)
        return targets

    def after(self, outcomes: list[TickResult], targets: Targets, now_s: float) -> None:
        """See `TickStage.after`: takes the commands."""
        for body, settling, outcome in zip(self.bodies, self.settlings, outcomes, strict=True):
            device, state = outcome.device, outcome.state
            if device and body.device and state.enabled and state.squeeze is None:
                body.note(device)
                settling.goal = device
                continue
            samples = self._exchange.samples_of(body.config)
            settling.goal = device or settling.goal
            if device and state.enabled:
                settling.last = settling.until_s = None
                body.command(device if state.squeeze is None else (), samples)
            elif settling.goal and settling.last is None:
                # In the tick of the last command the devices are asked to rest.
                holds = state.pending[-1:] == (Effect.HOLD,) and state.mode is not Mode.FAULT
                settling.leave(samples, holds, now_s)
                body.command((), samples)

    def settle(self, now_s: float) -> None:
        """See `TickStage.settle`: looks whether axes arrived that the last command left on their way."""
        for body, settling in zip(self.bodies, self.settlings, strict=True):
            if settling.until_s is not None:
                settling.settle(self._exchange.samples_of(body.config), now_s)

    @property
    def settled(self) -> bool:
        """False while an axis may still arrive after the end of a motion."""
        return all(settling.until_s is None for settling in self.settlings)

    def places(self, index: int) -> list[AxisPlace]:
        """Command and measurement of every axis of a robot, now or at the end of its last motion."""
        settling, config = self.settlings[index], self.bodies[index].config
        return settling.places(self._exchange.samples_of(config)) if settling.last is None else settling.last
