"""Calls the watch of clearance in every tick, and decides how a robot that would come too near stops.

A robot that follows a stream or goes to a point holds, with a refusal; one on its way to the rest pose stops
where it is; one that follows a trajectory, which was checked before, has fault 303.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from contid.clearance.guard import ClearanceGuard
from contid.control.engine.cycle import Sink
from contid.control.engine.events.orders import OrderRefused
from contid.control.engine.exchange import Exchange
from contid.control.engine.robots import Robots
from contid.control.engine.sources import Timed
from contid.control.engine.target_selector import TargetSelector
from contid.control.tick import transitions
from contid.control.tick.axis_motions import braking_at_once
from contid.control.tick.clearance_watch import ClearanceWatch
from contid.control.tick.robot_tick import TickResult, tick
from contid.control.tick.state import RobotState
from contid.control.tick.supervisor import Mode
from contid.robot_file.base import StopPolicy
from contid.targets import Target


class ClearanceOrders:
    """Ticks of robots whose bodies are kept apart."""

    def __init__(self, guard: ClearanceGuard | None, robots: Robots, exchange: Exchange, sink: Sink) -> None:
        self._watch = None if guard is None else ClearanceWatch(guard, robots.configs)
        self._robots = robots
        self._exchange = exchange
        self._sink = sink
        #: Targets of a stream that were refused; a robot holds until it gets another one.
        self._refused: dict[int, Target] = {}

    def before_tick(self, targets: Mapping[str, Target | None]) -> Mapping[str, Target | None]:
        """The targets, with None instead of one that was refused before."""
        if not self._refused:
            return targets
        kept = dict(targets)
        for index, refused in list(self._refused.items()):
            name = self._robots.configs[index].name
            if kept.get(name) == refused:
                kept[name] = None
            else:
                del self._refused[index]
        return kept

    def after_tick(
        self,
        outcomes: list[TickResult],
        targets: Mapping[str, Target | None],
        now_s: float,
        selector: TargetSelector,
    ) -> set[int]:
        """Replace the results of robots that come too near by results that stop them; their indices."""
        held: set[int] = set()
        if self._watch is None:
            return held
        timed = isinstance(selector.source, Timed)

        def stopped(index: int, message: str) -> TickResult:
            held.add(index)
            config, before = self._robots.configs[index], self._robots.states[index]
            after = self._after(index, before, message, targets, now_s, timed)
            return tick(config, after, now_s, self._exchange.samples_of(config), None)

        self._watch.allowed(outcomes, targets, self._exchange.samples_of, stopped)
        return held

    def _after(
        self,
        index: int,
        before: RobotState,
        message: str,
        targets: Mapping[str, Target | None],
        now_s: float,
        timed: bool,
    ) -> RobotState:
        """The state that stops in the shortest way, and why."""
        config = self._robots.configs[index]
        if before.mode in (Mode.RUN, Mode.APPROACH, Mode.HOLD) and (
            before.goto is not None or before.follow or before.squeeze is not None
        ):
            if before.recovering or (timed and before.goto is None):
                return transitions.too_near(config, before, message, now_s)
            target = targets.get(config.name)
            if before.goto is None and target is not None:
                self._refused[index] = target
            self._refuse(config.name, f"{message}; it holds")
            held = before
            if before.mode is not Mode.HOLD:
                held = transitions.stay(config, before, now_s)
            return braking_at_once(config, _without_goto(held), now_s)
        if before.mode is Mode.STOPPING and before.policy is StopPolicy.REST:
            self._refuse(config.name, f"{message}; it stops where it is instead of at its rest pose")
            after = transitions.stop(config, before, StopPolicy.HOLD, now_s)
            return braking_at_once(config, after, now_s)
        return braking_at_once(config, before, now_s)

    def _refuse(self, name: str, message: str) -> None:
        self._sink.event(OrderRefused(robot=name, message=f"{name}: {message}"))


def _without_goto(state: RobotState) -> RobotState:
    return replace(state, goto=None, follow=state.follow and state.goto is None)
