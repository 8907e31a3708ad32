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
compared.
Everything is a function of commands and recorded samples, so a replay decides the same.
"""

from __future__ import annotations

from contid.control.engine.cycle import Timing
from contid.control.engine.exchange import Exchange
from contid.control.engine.robots import Robots
from contid.control.engine.stages import Targets, TickStage
from contid.control.engine.watch.watched_body import FUTURE_S, AxisPlace, WatchedBody
from contid.control.tick.faults import Fault
from contid.control.tick.robot_tick import TickResult
from contid.control.tick.state import Effect
from contid.control.tick.supervisor import Mode


class BodyWatch(TickStage):
    """The bodies of all robots.

    Attributes:
        bodies: by index of the robot.
        behind: greatest distance of a measurement of this tick from its range, as a share of its tolerance.
    """

    def __init__(self, robots: Robots, exchange: Exchange) -> None:
        self.robots = range(len(robots.configs))
        self._robots = robots
        self._exchange = exchange
        self._skipped = 0
        self.behind = 0.0
        self.bodies = [WatchedBody(config) for config in robots.configs]

    def before(self, targets: Targets, timing: Timing, now_s: float) -> Targets:
        """See `TickStage.before`: compares the newest measurements."""
        samples = self._exchange.samples
        latest_s = timing.deadline_s + timing.lateness_s + FUTURE_S
        gap, self._skipped = timing.skipped != self._skipped, timing.skipped
        self.behind = 0.0
        for index, body in enumerate(self.bodies):
            if not body.device:
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
            fault, message = body.compare(self._exchange.samples_of(body.config), latest_s, gap)
            self.behind = max(self.behind, body.behind)
            if fault is not Fault.NONE:
                self._robots.fail(index, fault, message, now_s)
        return targets

    def after(self, outcomes: list[TickResult], targets: Targets, now_s: float) -> None:
        """See `TickStage.after`: takes the commands."""
        for body, outcome in zip(self.bodies, outcomes, strict=True):
            device, state = outcome.device, outcome.state
            if device and body.device and not body.awake and state.enabled and state.squeeze is None:
                body.note(device)
                body.goal = body.device = device
                continue
            samples = self._exchange.samples_of(body.config)
            body.goal = device or body.goal
            if device and state.enabled:
                body.last = body.settles_s = None
                body.command(device if state.squeeze is None else (), samples)
            elif body.goal and body.last is None:
                # In the tick of the last command the devices are asked to rest.
                holds = state.pending is Effect.HOLD and state.mode is not Mode.FAULT
                body.leave(samples, holds, now_s)
                body.command((), samples)

    def settle(self, now_s: float) -> None:
        """See `TickStage.settle`: looks whether axes arrived that the last command left on their way."""
        for body in self.bodies:
            if body.settles_s is not None:
                body.settle(self._exchange.samples_of(body.config), now_s)

    @property
    def settled(self) -> bool:
        """False while an axis may still arrive after the end of a motion."""
        return all(body.settles_s is None for body in self.bodies)

    def places(self, index: int) -> list[AxisPlace]:
        """Command and measurement of every axis of a robot, now or at the end of its last motion."""
        body = self.bodies[index]
        return body.places(self._exchange.samples_of(body.config)) if body.last is None else body.last
