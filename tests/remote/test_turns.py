"""Clients that do not wait for responses leave the event loop most of its time; others are not delayed."""

from __future__ import annotations

import asyncio

import pytest

from contid.remote.server.turns import BURST_S, SHARE, Turns

pytestmark = pytest.mark.process

REQUEST_S = 1e-3


class VirtualTime:
    """A clock that sleeping and requests move on."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.slept_s = 0.0

    def now(self) -> float:
        return self.now_s

    async def sleep(self, duration_s: float) -> None:
        self.now_s += duration_s
        self.slept_s += duration_s
        await asyncio.sleep(0)


async def served(time: VirtualTime, turns: Turns, more_wait: bool, until_s: float) -> int:
    count = 0
    while time.now_s < until_s:
        async with turns.turn(more_wait):
            time.now_s += REQUEST_S
            await asyncio.sleep(0)
        count += 1
    return count


@pytest.mark.parametrize("clients", [1, 5])
def test_a_flood_takes_its_share_and_no_more(clients: int) -> None:
    async def flood() -> float:
        time = VirtualTime()
        turns = Turns(time.now, time.sleep)
        counts = await asyncio.gather(*(served(time, turns, True, 100.0) for _ in range(clients)))
        return sum(counts) * REQUEST_S / time.now_s

    assert asyncio.run(flood()) == pytest.approx(SHARE, rel=0.02)


def test_requests_sent_together_are_not_delayed() -> None:
    time = VirtualTime()
    asyncio.run(served(time, Turns(time.now, time.sleep), True, BURST_S))
    assert time.slept_s == 0.0


def test_a_client_that_waits_for_its_responses_is_not_delayed_beside_a_flood() -> None:
    async def both() -> tuple[float, float]:
        time = VirtualTime()
        turns = Turns(time.now, time.sleep)
        await served(time, turns, True, 10.0)
        before_s = time.slept_s
        await served(time, turns, False, 20.0)
        return before_s, time.slept_s

    before_s, after_s = asyncio.run(both())
    assert before_s > 5.0
    assert after_s == before_s
