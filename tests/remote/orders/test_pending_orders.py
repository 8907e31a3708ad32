"""Which refusals belong to orders that wait for their confirmation: those with their number."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from contid.control.engine.events import RunEvent
from contid.control.engine.events.robots import MarkReached, OrderRefused
from contid.control.engine.messages import ClearFault, Estop, Goto, Hold, Message, Recover
from contid.control.engine.virtual import VirtualProcess
from contid.remote.server.pending_orders import PendingOrders
from contid.targets import Target
from tests.support.fingers import load

TICK = 50


class Answered:
    """A finger in virtual time, which reads the marks of orders in two ticks."""

    def __init__(self) -> None:
        self.sent: list[Message] = []
        control: Any = SimpleNamespace(send=self.sent.append, refresh=lambda: None)
        self.pending = PendingOrders(control)
        self.process = VirtualProcess(load(1), 200.0, self, attended=True)
        self.process.engine.arm()

    def write(self, values: list[float]) -> None: ...

    def event(self, event: RunEvent) -> None:
        self.pending.notice(event)

    def go(self, between: OrderRefused) -> None:
        """Obey the first mark, then in the next tick the rest; in the tick between a robot refuses."""
        engine = self.process.engine
        for tick in range(TICK + 10):
            self.process.begin()
            if tick == TICK:
                engine.obey(self.sent[0], tick)
            if tick == TICK + 1:
                engine._sink.event(between)
                for message in self.sent[1:]:
                    engine.obey(message, tick)
            self.process.turn()
        self.process.close()
        self.pending.close()


@pytest.mark.parametrize("order", [Hold(("f0",)), Estop(), Recover(("f0",))])
async def test_a_refusal_between_two_marks_is_not_that_of_the_order(order: Message) -> None:
    """Such as that of an earlier order to clear a fault, which the devices answer in this tick."""
    run = Answered()
    future = run.pending.send([order])
    run.go(OrderRefused(robot="f0", message="not cleared"))
    result = await future
    assert "not cleared" not in str(result.refused)
    assert bool(result.refused) is isinstance(order, Recover)  # every axis is within its limits


async def test_a_refusal_of_one_order_is_not_that_of_the_next() -> None:
    run = Answered()
    unreached = Goto("f1", Target(tip_m=(0.05, 0.075, 0.0)))  # there is no such robot
    refused, held = run.pending.send([unreached]), run.pending.send([Hold(("f0",))])
    run.go(OrderRefused(robot="f0", message="not cleared"))
    assert (await refused).refused.keys() == {"f1"}
    assert not (await held).refused


async def test_a_stop_that_goes_on_is_no_refusal() -> None:
    control: Any = SimpleNamespace(send=lambda message: None, refresh=lambda: None)
    pending = PendingOrders(control)
    future = pending.send([ClearFault()])
    pending.notice(MarkReached(number=1, tick=4))
    pending.notice(OrderRefused(robot="f0", message="it goes on", answers=2, stronger="relax"))
    pending.notice(OrderRefused(message="of no order"))
    pending.notice(MarkReached(number=2, tick=5))
    result = await future
    assert (result.tick, result.refused, result.stronger) == (5, {}, {"f0": "it goes on"})
    pending.close()
