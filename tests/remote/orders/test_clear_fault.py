"""What an order to clear a fault answers: the states of its tick, and refusals of its own alone."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from contid.control.engine.events.robots import OrderRefused
from contid.control.tick.supervisor import Mode
from contid.remote.protocol.wire import RemoteError, RequestFields
from contid.remote.server.checks import ClientTurns
from contid.remote.server.motion_orders import MotionOrders

FOREIGN = (OrderRefused(robot="f0", message="f0: cannot hold", answers=4),)
OWN = (OrderRefused(robot="f0", message="f0: not cleared, f0.left reports overload"),)


def orders(modes: Iterator[Mode], events: tuple[Any, ...], refused: dict[str, str]) -> MotionOrders:
    """The motion orders of a run whose robot is in these modes in the ticks that follow."""
    ticks: list[Mode] = [Mode.FAULT]

    def newest() -> Mode:
        ticks.append(next(modes, ticks[-1]))
        return ticks[-1]

    async def confirmed(sent: object) -> Any:
        for event in events:
            found.notice(event)
        return SimpleNamespace(refused=refused)

    view = SimpleNamespace(
        faults=lambda record, robots: {"f0": {"number": 103}}, mode=lambda name, record: record
    )
    run: Any = SimpleNamespace(
        control=SimpleNamespace(newest=newest),
        view=view,
        pending=SimpleNamespace(send=lambda orders: orders, confirmed=confirmed),
        moves=SimpleNamespace(turns=ClientTurns()),
        lease=SimpleNamespace(check_free=lambda client, now_s: None),
        robots_of=lambda request: None,
        states=lambda robots, record: {"f0": record.name},
    )
    found = MotionOrders(run)
    return found


async def clear(found: MotionOrders) -> Any:
    return await found.verbs["clear_fault"](SimpleNamespace(number=1), RequestFields({}))


async def test_the_refusal_of_another_order_is_none_of_this_one() -> None:
    """Devices that are cleared for some ticks, meanwhile a hold of another client is refused."""
    modes = iter([Mode.FAULT, Mode.FAULT, Mode.FAULT, Mode.READY])
    assert (await clear(orders(modes, FOREIGN, {})))["cleared"] == ["f0"]


async def test_the_states_are_those_in_which_it_was_cleared() -> None:
    """It may be in FAULT again a moment later."""
    modes = iter([Mode.FAULT, Mode.READY, Mode.FAULT])
    assert (await clear(orders(modes, (), {})))["robots"] == {"f0": "READY"}


@pytest.mark.parametrize(("events", "refused"), [(OWN, {}), ((), {"f0": OWN[0].message})])
async def test_what_devices_and_robots_refuse_is_the_answer(
    events: tuple[Any, ...], refused: dict[str, str]
) -> None:
    with pytest.raises(RemoteError, match="reports overload"):
        await clear(orders(iter([Mode.FAULT]), events, refused))
