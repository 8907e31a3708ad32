"""The gotos of moves in the server: each move gets its own end only."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from typing import Any

import pytest

from contid.control.engine.events.robots import GotoEnded, MarkReached, OrderRefused, SqueezeChanged
from contid.control.engine.messages import Hold, Mark
from contid.remote.protocol.wire import RemoteError
from contid.remote.server.gotos import Gotos
from contid.remote.server.move import Move
from contid.remote.server.pending_orders import PendingOrders
from contid.targets import Target

HERE = Target(tip_m=(0.0, 0.05, 0.0))


class Robots:
    """A control process that takes orders and answers when a test asks for it, and its view."""

    rate_hz = 200.0

    def __init__(self) -> None:
        self.sent: list[Any] = []
        self.configs = dict.fromkeys(("left", "right"))
        self.pending = PendingOrders(self)  # type: ignore[arg-type]
        self.gotos = Gotos(self, self, self.pending)  # type: ignore[arg-type]
        self.notices: list[tuple[int, bool, str]] = []

    def send(self, message: object) -> None:
        self.sent.append(message)

    def refresh(self) -> None:
        pass

    def newest(self) -> None:
        return None

    def record_of(self, tick: int) -> object:
        return object()

    def faults(self, record: object, robots: object) -> dict[str, Any]:
        return {}

    def move(self, number: int) -> Move:
        return Move(number, 1, lambda sent: self.notices.append((number, sent["reached"], sent["message"])))

    def answer(self, *refusals: OrderRefused, tick: int = 1) -> None:
        """The events of the newest orders."""
        before, after = [each for each in self.sent if isinstance(each, Mark)][-2:]
        for event in (
            MarkReached(number=before.number, tick=tick),
            *[replace(refusal, answers=after.number) for refusal in refusals],
            MarkReached(number=after.number, tick=tick),
        ):
            self.pending.notice(event)

    async def begin(self, number: int, *robots: str, refused: str = "", tick: int = 1) -> None:
        begun = asyncio.create_task(self.gotos.begin(self.move(number), dict.fromkeys(robots, HERE)))
        await asyncio.sleep(0)
        self.answer(*[OrderRefused(robot=refused, message="no way")] * bool(refused), tick=tick)
        await begun


async def test_a_move_gets_its_own_end_after_one_that_was_refused() -> None:
    robots = Robots()
    with pytest.raises(RemoteError, match="no way"):
        await robots.begin(1, "left", refused="left")
    await robots.begin(2, "left")
    robots.gotos.ended(GotoEnded(robot="left", arrived=True, tick=5))
    assert robots.notices == [(2, True, "")]


async def test_where_one_robot_refuses_the_others_hold_and_no_end_is_sent() -> None:
    robots = Robots()
    with pytest.raises(RemoteError, match="no way"):
        await robots.begin(1, "left", "right", refused="left")
    assert robots.sent[-1] == Hold(("right",))
    robots.gotos.ended(GotoEnded(robot="right", arrived=False, tick=5))
    assert robots.notices == []
    await robots.begin(2, "right")
    robots.gotos.ended(GotoEnded(robot="right", arrived=True, tick=9))
    assert robots.notices == [(2, True, "")]


@pytest.mark.parametrize("refused", [False, True])
async def test_a_move_confirmed_too_late_takes_no_end_of_another(
    refused: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    robots = Robots()
    confirmed = robots.pending.confirmed
    monkeypatch.setattr(robots.pending, "confirmed", lambda result: confirmed(result, 0.01))
    with pytest.raises(RemoteError, match="has not confirmed it"):
        await robots.gotos.begin(robots.move(1), {"left": HERE})
    robots.answer(*[OrderRefused(robot="left", message="no way")] * refused)
    await robots.begin(2, "left", tick=5)
    for arrived in (False, True)[refused:]:
        robots.gotos.ended(GotoEnded(robot="left", arrived=arrived, tick=5))
    assert robots.notices == [(2, True, "")]


async def test_the_reason_of_a_move_survives_the_order_of_the_next_one() -> None:
    robots = Robots()
    await robots.begin(1, "left")
    lost = SqueezeChanged(tick=3, robot="left", what="lost", force_n=0.0, message="lost the object")
    robots.gotos.squeezed(lost)
    await robots.begin(2, "left", tick=5)
    robots.gotos.ended(GotoEnded(robot="left", arrived=False, tick=5))
    robots.gotos.ended(GotoEnded(robot="left", arrived=False, tick=6))
    assert robots.notices == [
        (1, False, "left did not arrive; left: lost the object"),
        (2, False, "left did not arrive"),
    ]


@pytest.mark.parametrize("refused", [False, True])
async def test_a_move_gets_its_own_end_after_one_whose_end_was_lost(refused: bool) -> None:
    """Such as in a ring that was overrun; by their order alone the second move would never end."""
    robots = Robots()
    await robots.begin(1, "left", tick=10)
    if refused:
        with pytest.raises(RemoteError, match="no way"):
            await robots.begin(2, "left", refused="left", tick=15)
    await robots.begin(3, "left", tick=20)
    robots.gotos.ended(GotoEnded(robot="left", arrived=True, tick=30))
    assert [(number, reached) for number, reached, _ in robots.notices] == [(1, False), (3, True)]
    assert "its end was not seen" in robots.notices[0][2]


async def test_the_end_of_a_move_that_another_replaces_is_its_own() -> None:
    robots = Robots()
    await robots.begin(1, "left", tick=10)
    await robots.begin(2, "left", tick=20)
    robots.gotos.ended(GotoEnded(robot="left", arrived=False, tick=20))
    assert [(number, reached) for number, reached, _ in robots.notices] == [(1, False)]
