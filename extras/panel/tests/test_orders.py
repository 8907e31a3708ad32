"""Orders of a page: stops need no lease, motions do, and a page that falls silent loses it."""

from __future__ import annotations

import asyncio
import json
import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from contid.remote.protocol.wire import Fields, RequestFields
from contid_panel.page import MAX_PENDING, Page
from tests.support.daemons import FAR, HERE, Running, command, states
from tests.support.panels import PanelClient, PanelProcess, page, panel
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime]


def _target(point: dict[str, float]) -> dict[str, float]:
    return {f"f0.{name}": value for name, value in point.items()}


async def _alive(it: PanelClient) -> None:
    """The heartbeat of a page that is open and visible."""
    while True:
        await it.send("beat")
        await asyncio.sleep(0.2)


async def _states(it: PanelClient, *expected: str) -> None:
    await it.until(lambda page: page.state("f0") in expected)


@pytest.mark.parametrize(
    "text",
    ['{"id":1,"verb":"estop"}', '{"id":{},"verb":"estop","robots":7}', '\ufeff{"verb": "E-STOP"', "estop!"],
)
async def test_stop_needs_no_lease_and_no_grammar(served: PanelProcess, running: Running, text: str) -> None:
    with running.client(name="other") as other:
        other.acquire(30.0)
        async with page(served) as it:
            await it.connection.send(text)
            await _states(it, "OFF")
    until(running.off, "the devices are without torque")


def test_stop_by_request_for_a_page_whose_socket_is_lost(served: PanelProcess, running: Running) -> None:
    response = served.request("POST", "/api/estop", content=b"anything")
    assert response.json()["robots"] == {"f0": "OFF", "f1": "OFF"}
    until(running.off, "the devices are without torque")


def test_a_read_only_panel_stops(running: Running) -> None:
    async def stop(served: PanelProcess) -> None:
        async with page(served) as it:
            assert (await it.order("estop"))["ok"]

    with panel(running, "--read-only") as served:
        asyncio.run(stop(served))
    until(running.off, "the devices are without torque")


async def test_motions_need_the_lease_of_this_page(served: PanelProcess, running: Running) -> None:
    async with page(served) as it:
        for verb, fields in (
            ("goto", {"target": _target(FAR)}),
            ("jog", {"columns": ["f0.x_mm", "f0.y_mm"], "rows": [[30, 85]]}),
        ):
            reply = await it.order(verb, **fields)
            assert reply["error"]["code"] == "lease-held", reply
        assert (await it.order("acquire"))["ok"]
        beats = asyncio.create_task(_alive(it))
        assert (await it.order("goto", target=_target(FAR)))["ok"]
        await it.until(lambda page: page.tip_mm()[0] < 32)
        beats.cancel()


async def test_a_jog_follows_and_ends_where_it_was_left(served: PanelProcess) -> None:
    async with page(served) as it:
        await it.order("acquire")
        beats = asyncio.create_task(_alive(it))
        for step in range(20):
            reply = await it.order("jog", columns=["f0.x_mm", "f0.y_mm"], rows=[[50.0 - step, 75.0]])
            assert reply["ok"], reply
            assert not reply["result"]["refused"]
            await asyncio.sleep(0.03)
        reply = await it.order("jog", columns=["f0.x_mm", "f0.y_mm"], rows=[[5000.0, 75.0]])
        assert "out of reach" in reply["result"]["refused"][0]
        await it.order("jog", columns=["f0.x_mm", "f0.y_mm"], rows=[[31.0, 75.0]])
        assert (await it.order("jog_end"))["ok"]
        await it.until(lambda page: abs(page.tip_mm()[0] - 31.0) < 0.5)
        await _states(it, "HOLD")
        beats.cancel()


async def test_a_jog_after_another_order_loses_no_row(served: PanelProcess) -> None:
    """An order within the time that a key is held ends the jog at the daemon; no end of it is sent."""
    columns = ["f0.x_mm", "f0.y_mm"]
    async with page(served) as it:
        await it.order("acquire")
        beats = asyncio.create_task(_alive(it))
        others: tuple[tuple[str, dict[str, object]], ...] = (
            ("home", {"robots": ["f0"]}), ("goto", {"target": _target(HERE)}), ("hold", {}),
        )  # fmt: skip
        for verb, fields in others:
            for reply in (
                await it.order("jog", columns=columns, rows=[[45.0, 78.0]]),
                await it.order(verb, **fields),
                await it.order("jog", columns=columns, rows=[[46.0, 78.0]]),
            ):
                assert reply["ok"], (verb, reply)
        assert (await it.order("jog_end"))["ok"]
        await it.until(lambda page: abs(page.tip_mm()[0] - 46.0) < 0.5)
        beats.cancel()


@pytest.mark.parametrize("share", [1.0, 0.5])
async def test_an_order_before_a_hold_begins_no_motion_after_it(served: PanelProcess, share: float) -> None:
    """The panel asks the daemon who holds the lease before it sends a motion; the hold comes meanwhile."""
    column, row = ["f0.x_mm", "f0.y_mm"], list(FAR.values())
    async with page(served) as it:
        await it.order("acquire")
        beats = asyncio.create_task(_alive(it))
        orders: tuple[tuple[str, dict[str, object]], ...] = (
            ("goto", {"target": _target(FAR), "share": share}), ("jog", {"columns": column, "rows": [row]}),
        )  # fmt: skip
        for verb, fields in orders:
            await it.until(lambda page: page.state("f0") == "HOLD")
            before_mm = it.tip_mm()
            await it.send(verb, **fields)
            held = await it.order("hold")
            assert held["ok"]
            for _ in range(20):  # what began after the hold shows within 0.4 s
                await it.until(lambda page: page.newest.pop("frame", None) is not None)
                await it.until(lambda page: "frame" in page.newest)
                assert it.tip_mm() == pytest.approx(before_mm, abs=0.1), verb
        # An order that is given after the hold is carried out.
        assert (await it.order("goto", target=_target(FAR)))["ok"]
        await it.until(lambda page: page.tip_mm()[0] < 32)
        beats.cancel()


async def test_numbers_too_large_for_a_float_are_refused(served: PanelProcess) -> None:
    """In JSON an integer may have any length; a page that got no reply would wait for one."""
    huge = 10**400
    async with page(served) as it:
        await it.until(lambda page: page.state("f0") == "HOLD")
        await it.order("acquire")
        for verb, fields in (
            ("goto", {"target": {"f0.x_mm": huge, "f0.y_mm": 75.0}, "share": 0.5}),
            ("goto", {"target": {"f0.x_mm": huge, "f0.y_mm": 75.0}}),
            ("goto", {"target": _target(FAR), "pressed_ms": huge}),
            ("jog", {"columns": ["f0.x_mm", "f0.y_mm"], "rows": [[30.0, 85.0]], "pressed_ms": -huge}),
            ("beat", {"pressed_ms": huge}),
        ):
            async with asyncio.timeout(5.0):
                number = await it.send(verb, **fields)
                while verb != "beat":
                    reply = await it.message()
                    if reply["kind"] == "reply" and reply["id"] == number:
                        assert reply["error"]["code"] in ("bad-request", "bad-target", "expired"), reply
                        break


def _unconnected() -> Page:
    """The panel's side of a page, without a daemon."""
    return Page(cast(Any, SimpleNamespace(path=Path("none"))), cast(Any, None), cast(Any, None), False)


async def test_stops_that_wait_keep_no_other_order_away(monkeypatch: pytest.MonkeyPatch) -> None:
    it, goes_on = _unconnected(), asyncio.Event()

    async def wait(request: RequestFields) -> Fields:
        await goes_on.wait()
        return {}

    async def release(request: RequestFields) -> Fields:
        return {"released": True}

    monkeypatch.setitem(it._orders, "hold", wait)
    monkeypatch.setitem(it._orders, "release", release)
    for number in range(MAX_PENDING):
        it._take(f'{{"id": {number}, "verb": "hold"}}'.encode(), False)
    it._take(b'{"id": 99, "verb": "release"}', False)
    async with asyncio.timeout(5.0):
        text = await it._mailbox.take()
        goes_on.set()
        await asyncio.gather(*it._pending)
    assert text is not None
    assert json.loads(text)["result"] == {"released": True}


async def test_an_order_that_fails_by_a_defect_is_answered(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    it = _unconnected()

    async def defect(request: RequestFields) -> Fields:
        raise KeyError("rest")

    monkeypatch.setitem(it._orders, "hold", defect)
    it._take(b'{"id": 7, "verb": "hold"}', False)
    async with asyncio.timeout(5.0):
        text = await it._mailbox.take()
    assert text is not None
    reply = json.loads(text)
    assert (reply["id"], reply["ok"], reply["error"]["code"]) == (7, False, "internal")
    assert "KeyError: 'rest'" in reply["error"]["message"]
    assert "page" in caplog.text


async def test_pages_that_end_in_the_middle_of_an_order(served: PanelProcess) -> None:
    """The panel's messages on stderr are checked at its end; no page may leave a traceback."""
    for _ in range(5):
        async with page(served) as it:
            for verb in ("acquire", "beat", "hold", "resume", "clear_fault", "release"):
                await it.send(verb)
        async with page(served) as it:
            await it.send("acquire")
            it.connection.transport.abort()


async def _moving(it: PanelClient) -> None:
    """Acquire the lease and follow a jog for a while; the robot is on its way to a far point."""
    assert (await it.order("acquire"))["ok"]
    for x in (45.0, 40.0, 35.0):
        assert (await it.order("jog", columns=["f0.x_mm", "f0.y_mm"], rows=[[x, 80.0]]))["ok"]
    await _states(it, "APPROACH", "RUN")


async def test_a_page_that_falls_silent_loses_the_lease(served: PanelProcess, running: Running) -> None:
    """A frozen or hidden page keeps its sockets open, and sends no heartbeat."""
    async with page(served) as it:
        await _moving(it)
        await _states(it, "HOLD")
        with running.client() as client:
            assert client.status()["lease"]["holder"] is None
        # What it sends when it goes on moves nothing.
        reply = await it.order("jog", columns=["f0.x_mm", "f0.y_mm"], rows=[[60.0, 75.0]])
        assert reply["error"]["code"] == "refused"
        reply = await it.order("jog", columns=["f0.x_mm", "f0.y_mm"], rows=[[60.0, 75.0]])
        assert reply["error"]["code"] == "lease-held"


async def test_a_page_that_is_closed_loses_the_lease(served: PanelProcess, running: Running) -> None:
    async with page(served) as it:
        await _moving(it)
    with running.client() as client:
        until(lambda: client.status()["lease"]["holder"] is None, "the lease is free")
        until(lambda: states(client) == {"HOLD"}, "the robots hold")


async def test_a_page_that_only_watches_may_close(served: PanelProcess, running: Running) -> None:
    with running.client(name="script") as script:
        script.acquire(30.0)
        move = script.move(_target(FAR), wait=False)
        async with page(served) as it:
            await it.until(lambda page: "frame" in page.newest)
        script.wait(move)


async def test_another_client_takes_the_lease(served: PanelProcess, running: Running) -> None:
    async with page(served) as it:
        await _moving(it)
        with running.client(name="script") as script:
            script.acquire(30.0, takeover=True)
            await it.until(lambda page: page.holder() == "script")
            reply = await it.order("goto", target=_target(HERE))
            assert reply["error"]["code"] == "lease-held"
            reply = await it.order("acquire")
            assert "script" in reply["error"]["message"]
            assert (await it.order("acquire", takeover=True))["ok"]


@pytest.mark.usefixtures("alone")
async def test_the_daemon_restarts_and_nothing_resumes(served: PanelProcess, running: Running) -> None:
    async with page(served) as it:
        await _moving(it)
        running.process.kill()
        running.process.wait()
        await it.until(lambda page: not page.newest["daemon"]["connected"])
        robot_file = str(running.folder / "fingers.yaml")
        again = subprocess.Popen(
            command("run", robot_file, "--socket", str(running.socket), "--disarmed"),
            stdin=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
        )
        try:
            await it.until(lambda page: page.newest["daemon"]["connected"] and page.state() == "READY")
            reply = await it.order("jog", columns=["f0.x_mm", "f0.y_mm"], rows=[[60.0, 75.0]])
            assert not reply["ok"]
            await it.until(lambda page: page.holder() is None)
            assert it.state() == "READY"
            assert (await it.order("estop"))["ok"]
        finally:
            again.terminate()
            again.wait()


async def test_a_trajectory_is_checked_and_shown_before_it_is_played(served: PanelProcess) -> None:
    rows = "".join(f"{0.1 * k:.1f},{50 - k},75\n" for k in range(11))
    async with page(served) as it:
        await it.until(lambda page: "frame" in page.newest)
        bad = served.request(
            "POST", "/api/check?name=bad.csv", content=b"t_s,f0.x_mm,f0.y_mm\n0,50,75\n1,9999,75\n"
        )
        assert "bad.csv:3" in bad.json()["findings"][0]
        good = served.request(
            "POST", "/api/check?name=line.csv", content=f"t_s,f0.x_mm,f0.y_mm\n{rows}".encode()
        ).json()
        assert good["ok"], good
        assert good["duration_s"] == pytest.approx(1.0)
        assert good["paths"]["f0"][-1] == pytest.approx([40.0, 75.0, 0.0])
        assert (await it.order("play", check="unknown"))["error"]["code"] == "bad-target"
        assert (await it.order("play", check=good["check"]))["error"]["code"] == "lease-held"
        await it.order("acquire")
        beats = asyncio.create_task(_alive(it))
        assert (await it.order("play", check=good["check"]))["ok"]
        await it.until(lambda page: page.tip_mm()[0] < 40.5)
        beats.cancel()
