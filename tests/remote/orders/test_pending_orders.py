"""Which refusals belong to orders that wait for their confirmation."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from contid.control.engine.events.robots import MarkReached, OrderRefused
from contid.control.engine.messages import ClearFault, Estop, Message
from contid.remote.server.pending_orders import PendingOrders


@pytest.mark.parametrize(
    ("order", "robot", "counts"),
    [
        (Estop(), "f0", False),  # of an earlier order to clear, which the devices answer in this tick
        (Estop(), "", True),  # of a defect: the stop was perhaps not carried out
        (ClearFault(), "f0", True),
    ],
)
async def test_no_refusal_by_a_robot_is_that_of_an_estop(order: Message, robot: str, counts: bool) -> None:
    control: Any = SimpleNamespace(send=lambda message: None, refresh=lambda: None)
    pending = PendingOrders(control)
    future = pending.send([order])
    refusal = OrderRefused(robot=robot, message="not cleared")
    for event in (MarkReached(number=1, tick=4), refusal, MarkReached(number=2, tick=5)):
        pending.notice(event)
    assert (await future).refused == ({robot: "not cleared"} if counts else {})
    pending.close()
