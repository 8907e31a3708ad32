"""Orders that wait while the panel or the daemon stands still: motions expire after a second, stops never."""

from __future__ import annotations

import asyncio
import os
import signal
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import pytest

from contid.remote.protocol.expiry import clock_s
from contid_panel.expiry import AHEAD_S, VALID_S
from tests.support.daemons import FAR, Running, states
from tests.support.panels import PanelClient, PanelProcess, page
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime]

TARGET = {f"f0.{name}": value for name, value in FAR.items()}
ROW = {"columns": ["f0.x_mm", "f0.y_mm"], "rows": [list(FAR.values())]}
#: Longer than an order is valid, shorter and longer than a lease; after 3 s the robots of a daemon stop.
PAUSES_S = [1.25, 2.5]


@asynccontextmanager
async def asleep(process: int, pause_s: float) -> AsyncIterator[None]:
    """A process stands still during the block and for a while longer."""
    os.kill(process, signal.SIGSTOP)
    try:
        yield
        await asyncio.sleep(pause_s)
    finally:
        os.kill(process, signal.SIGCONT)


async def reply(it: PanelClient, number: int) -> dict[str, Any]:
    """The reply to an order that was sent."""
    while (found := await it.message())["kind"] != "reply" or found["id"] != number:
        pass
    return found


def command_mm(running: Running) -> list[float]:
    """The commands of a robot."""
    with running.client() as client:
        return [axis["command_mm"] for axis in client.status()["robots"]["f0"]["axes"].values()]


@pytest.mark.parametrize("pause_s", PAUSES_S)
@pytest.mark.parametrize("sleeper", ["panel", "daemon"])
async def test_a_resume_that_waited_does_not_arm(
    served: PanelProcess, running: Running, sleeper: str, pause_s: float
) -> None:
    process = (served if sleeper == "panel" else running).process.pid
    async with page(served) as it:
        assert (await it.order("estop"))["ok"]
        async with asleep(process, pause_s):
            waiting = [await it.send(verb) for verb in ("resume", "recover", "clear_fault", "acquire")]
        for number in waiting:
            assert (await reply(it, number))["error"]["code"] == "expired"
        await asyncio.sleep(0.5)
        with running.client() as client:
            assert states(client) == {"OFF"}
        assert (await it.order("resume"))["ok"]
        await it.until(lambda page: page.state() == "HOLD")


@pytest.mark.parametrize("pause_s", PAUSES_S)
@pytest.mark.parametrize(("verb", "fields"), [("goto", {"target": TARGET}), ("jog", ROW)])
async def test_a_motion_that_waited_does_not_begin(
    served: PanelProcess, running: Running, verb: str, fields: dict[str, Any], pause_s: float
) -> None:
    async with page(served) as it:
        assert (await it.order("acquire"))["ok"]
        before = command_mm(running)
        async with asleep(served.process.pid, pause_s):
            number = await it.send(verb, **fields)
        assert (await reply(it, number))["error"]["code"] == "expired"
        await asyncio.sleep(0.5)
        assert command_mm(running) == before


async def test_heartbeats_that_waited_keep_no_lease(served: PanelProcess, running: Running) -> None:
    """A page that is closed while the panel sleeps has left them."""
    async with page(served) as it:
        assert (await it.order("acquire"))["ok"]
        async with asleep(served.process.pid, 1.2):
            for _ in range(8):
                await it.send("beat")
        with running.client() as client:
            until(lambda: client.status()["lease"]["holder"] is None, "the lease has lapsed", 1.2)


@pytest.mark.parametrize("sleeper", ["panel", "daemon"])
@pytest.mark.parametrize("verb", ["estop", "stop"])
async def test_a_stop_that_waited_stops(
    served: PanelProcess, running: Running, verb: str, sleeper: str
) -> None:
    process = (served if sleeper == "panel" else running).process.pid
    async with page(served) as it:
        await it.until(lambda page: page.state() == "HOLD")
        async with asleep(process, PAUSES_S[0]):
            number = await it.send(verb)
        assert (await reply(it, number))["ok"]
    until(running.off, "the devices are without torque")


async def test_a_press_of_no_time_or_of_another_clock_is_refused(served: PanelProcess) -> None:
    async with page(served) as it:
        for pressed_ms, code in (
            (None, "bad-request"),
            ("now", "bad-request"),
            ((clock_s() - VALID_S - 0.1) * 1e3, "expired"),
            ((clock_s() + AHEAD_S + 60.0) * 1e3, "expired"),
        ):
            assert (await it.order("resume", pressed_ms=pressed_ms))["error"]["code"] == code
        assert (await it.order("hold", pressed_ms=None))["ok"]
