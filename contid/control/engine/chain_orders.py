"""Calls the monitor of closed chains in every tick and at orders; its refusals become events."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from contid.control.engine.cycle import Sink
from contid.control.engine.events.orders import OrderRefused
from contid.control.engine.exchange import Exchange
from contid.control.engine.messages import RobotNames
from contid.control.engine.robots import Robots
from contid.control.tick.chain_monitor import ChainMonitor
from contid.control.tick.tip_feedback import Measurement
from contid.kinematics.rope.chain import ChainGuard
from contid.targets import Target


class ChainOrders:
    """Orders and ticks of the robots that are arms of chains."""

    def __init__(self, guards: Sequence[ChainGuard], robots: Robots, exchange: Exchange, sink: Sink) -> None:
        self._watch = ChainMonitor(guards, robots.configs)
        self._robots = robots
        self._exchange = exchange
        self._sink = sink
        self._chained = bool(guards)
        self._gotos: dict[str, Target] = {}

    def concerns(self, robot: str) -> bool:
        """True for the arms of chains."""
        return self._watch.concerns(robot)

    def goto(self, robot: str, target: Target) -> None:
        """Keep a goto of an arm until `begin_gotos` checks all of one tick together."""
        self._gotos[robot] = target

    def begin_gotos(self, now_s: float) -> None:
        """Begin or refuse the gotos of one tick."""
        if not self._gotos:
            return
        targets, self._gotos = self._gotos, {}
        for robot, message in self._watch.gotos(
            self._robots.states, targets, now_s, self._exchange.samples_of
        ):
            self._sink.event(OrderRefused(robot=robot, message=message))

    def stopped(self, who: RobotNames, now_s: float) -> None:
        """After an order that stops robots: hold their chains, stop forbidden paths to rest poses."""
        for robot, message in self._watch.stopped(self._robots.states, who, now_s, self._exchange.samples_of):
            self._sink.event(OrderRefused(robot=robot, message=message))

    def before_tick(
        self, targets: Mapping[str, Target | None], now_s: float, measured: Mapping[str, Measurement]
    ) -> Mapping[str, Target | None]:
        """Targets of this tick; forbidden approaches become faults."""
        if not self._chained:
            return targets
        targets = self._watch.targets(targets, self._robots.states)
        self._watch.begin(self._robots.states, targets, now_s, self._exchange.samples_of, measured)
        return targets

    def after_tick(self, now_s: float) -> None:
        """Fault the other arms of a chain with an arm in FAULT."""
        self._watch.faults(self._robots.states, self._robots.reported, now_s)
