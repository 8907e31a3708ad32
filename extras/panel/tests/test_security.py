"""Who gets in: foreign hosts, origins and tokens are refused, and floods do not move or stop anything."""

from __future__ import annotations

import asyncio
import json
import re
import socket
import time
from collections.abc import Iterator
from contextlib import AsyncExitStack, ExitStack, suppress
from typing import Any

import httpx
import psutil
import pytest
from websockets.exceptions import InvalidStatus

from contid_panel.limits import (
    HEADER_TIMEOUT_S,
    MAX_CONNECTIONS,
    MAX_PAGES,
    MAX_UPLOAD,
    RESPONSE_TIMEOUT_S,
)
from tests.support.daemons import Running, states
from tests.support.panels import PanelProcess, page, panel
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime]


@pytest.fixture(autouse=True)
def _nothing_moves(running: Running) -> Iterator[None]:
    """Whatever a test of this module sends, the robot holds where it is."""
    before = _commands(running)
    yield
    assert _commands(running) == before


def _commands(running: Running) -> dict[str, float]:
    with running.client() as client:
        robot = client.status()["robots"]["f0"]
    assert robot["state"] == "HOLD"
    return {name: axis["command_mm"] for name, axis in robot["axes"].items()}


def _refused(served: PanelProcess, status: int, **keys: Any) -> None:
    async def attempt() -> None:
        with pytest.raises(InvalidStatus) as refusal:
            async with page(served, **keys):
                pass
        assert refusal.value.response.status_code == status

    asyncio.run(attempt())


def test_the_page_comes_with_a_strict_policy(served: PanelProcess) -> None:
    response = httpx.get(served.origin + "/")
    assert response.status_code == 200
    assert "unsafe" not in response.headers["content-security-policy"]
    assert "default-src 'none'" in response.headers["content-security-policy"]
    assert response.headers["x-frame-options"] == "DENY"
    assert response.headers["cross-origin-resource-policy"] == "same-origin"
    assert not [name for name in response.headers if name.startswith("access-control")]
    assert served.token not in response.text


def test_browsers_keep_the_newest_files_only(served: PanelProcess) -> None:
    page = served.request("GET", "/")
    kept = [served.request("GET", name) for name in re.findall(r'(?:src|href)="([^"]+)"', page.text)]
    assert len(kept) == 4
    for response in kept:
        assert response.status_code == 200
        assert "immutable" in response.headers["cache-control"]
        other = served.request("GET", re.sub("/files/[^/]+", "/files/other", response.url.path))
        assert (other.headers["cache-control"], other.content) == ("no-store", response.content)
    for path in ("/", "/static/main.js", "/files/other/none.js", "/api/hello", "/api/modes"):
        assert served.request("GET", path).headers["cache-control"] == "no-store"


def test_nothing_listens_beyond_loopback(served: PanelProcess) -> None:
    (listener,) = [
        c
        for c in psutil.Process(served.process.pid).net_connections("inet")
        if c.status == psutil.CONN_LISTEN
    ]
    assert listener.laddr.ip == "127.0.0.1"


@pytest.mark.parametrize(
    "host", ["evil.example", "127.0.0.1.evil.example", "2130706433", "", "localhost@evil"]
)
def test_a_rebound_name_is_refused(served: PanelProcess, host: str) -> None:
    for method, path in (("GET", "/"), ("POST", "/api/estop"), ("GET", "/api/hello")):
        response = served.request(method, path, headers={"host": host, "origin": f"http://{host}"})
        assert response.status_code in (400, 403), (method, path)


def test_a_rebound_name_gets_no_socket(served: PanelProcess) -> None:
    origin = f"http://evil.example:{served.port}"
    _refused(served, 403, name="evil.example", origin=origin, host="127.0.0.1", port=served.port)


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "https://127.0.0.1:{port}", "http://127.0.0.1:1"]
)
def test_another_origin_is_refused(served: PanelProcess, origin: str) -> None:
    given = origin.format(port=served.port)
    assert served.request("POST", "/api/estop", headers={"origin": given}).status_code == 403
    assert served.request("POST", "/api/check", headers={"origin": given}).status_code == 403
    _refused(served, 403, origin=given)


def test_a_request_without_origin_is_refused(served: PanelProcess) -> None:
    assert served.request("POST", "/api/estop", headers={"origin": None}).status_code == 403
    _refused(served, 403, origin=None)


def test_a_cross_site_request_is_refused(served: PanelProcess) -> None:
    """What a form or an image of another site sends: no header of ours, and the browser's own marks."""
    headers = {"sec-fetch-site": "cross-site", "origin": "http://evil.example", "authorization": None}
    assert served.request("POST", "/api/estop", headers=headers).status_code == 403
    headers = {"sec-fetch-site": "cross-site", "origin": None}
    assert served.request("GET", "/api/hello", headers=headers).status_code == 403
    preflight = served.request("OPTIONS", "/api/estop", headers={"origin": "http://evil.example"})
    assert preflight.status_code == 403
    assert "access-control-allow-origin" not in preflight.headers


@pytest.mark.parametrize("token", ["x", "wrong", "ü" * 32])
def test_a_wrong_token_is_refused(served: PanelProcess, token: str) -> None:
    headers = {"authorization": f"Bearer {token}".encode()}
    assert served.request("GET", "/api/hello", headers=headers).status_code == 401
    assert served.request("POST", "/api/estop", headers=headers).status_code == 401
    assert served.request("GET", "/api/hello", headers={"authorization": None}).status_code == 401
    if token.isascii():
        _refused(served, 401, subprotocols=["contid.panel", f"contid.token.{token}"])
    _refused(served, 401, subprotocols=["contid.panel"])


async def test_an_oversized_message_closes_its_page_only(served: PanelProcess) -> None:
    async with page(served) as good, page(served) as bad:
        assert await bad.close_code(json.dumps({"id": 1, "verb": "goto", "target": "x" * 100_000})) == 1009
        await good.until(lambda it: it.state() == "HOLD")


async def test_malformed_messages_are_refused_and_then_closed(served: PanelProcess) -> None:
    async with page(served) as it:
        for text in (
            "",
            "[]",
            "nonsense",
            '{"id":1}',
            '{"id":{},"verb":"goto"}',
            '{"id":2,"verb":"jog","rows":1}',
        ):
            await it.connection.send(text)
            while (await it.message())["kind"] != "reply":
                pass
            assert not it.newest["reply"]["ok"], text
        await it.connection.send(b"\xff\xfe\x00")
        assert await it.close_code(*["nonsense"] * 20) == 1008


async def test_a_flood_of_messages_closes_its_page(served: PanelProcess) -> None:
    async with page(served) as it:
        assert await it.close_code(*['{"verb":"beat"}'] * 5000) == 1008


def test_a_large_upload_is_cut_off(served: PanelProcess) -> None:
    with suppress(httpx.WriteError):
        response = served.request("POST", "/api/check", content=b"x" * (MAX_UPLOAD + 1))
        assert response.status_code == 413


def test_one_upload_at_a_time(served: PanelProcess) -> None:
    """A second one is refused while the first has not come: what waits for memory is bounded."""
    head = (
        f"POST /api/check HTTP/1.1\r\nHost: 127.0.0.1:{served.port}\r\nOrigin: {served.origin}\r\n"
        f"Authorization: Bearer {served.token}\r\nContent-Length: 1000\r\n\r\n"
    )
    with socket.create_connection(("127.0.0.1", served.port)) as slow:
        slow.sendall(head.encode() + b"t_s,")
        until(
            lambda: served.request("POST", "/api/check", content=b"x").status_code == 503,
            "the first has begun",
        )
    until(lambda: served.request("POST", "/api/check", content=b"x").status_code == 200, "it is over")


async def test_forty_pages_are_refused_and_memory_stays(served: PanelProcess, running: Running) -> None:
    process = psutil.Process(served.process.pid)
    async with AsyncExitStack() as stack:
        first = await stack.enter_async_context(page(served))
        await first.until(lambda it: it.state() == "HOLD")
        before = process.memory_info().rss
        statuses = [await _opened(stack, served) for _ in range(40)]
        assert statuses == [101] * (MAX_PAGES - 1) + [503] * (41 - MAX_PAGES)
        # None of them reads any more; what waits for them is bounded.
        started_s = time.monotonic()
        while time.monotonic() - started_s < 3.0:
            await first.message()
        assert process.memory_info().rss - before < 10e6  # 0.5 MB were measured
        assert first.state() == "HOLD"
        with running.client() as client:
            assert states(client) == {"HOLD"}


async def _opened(stack: AsyncExitStack, served: PanelProcess) -> int:
    """The status of a handshake; an accepted page stays open."""
    try:
        await stack.enter_async_context(page(served))
    except InvalidStatus as refusal:
        return refusal.response.status_code
    return 101


def test_silent_connections_are_closed(served: PanelProcess) -> None:
    silent = [socket.create_connection(("127.0.0.1", served.port)) for _ in range(200)]
    at_once = 0
    began_s = time.monotonic()
    for connection in silent:
        with connection, suppress(ConnectionResetError):
            connection.settimeout(HEADER_TIMEOUT_S + 20.0)
            assert connection.recv(1) == b""
        at_once += time.monotonic() - began_s < 0.5 * HEADER_TIMEOUT_S
    assert at_once <= 200 - MAX_CONNECTIONS
    assert httpx.get(served.origin + "/").status_code == 200


#: What a client without the token does on each of its connections, after a first complete request or none.
WAITING = {
    "a second request": b"GET / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\nGET /",
    "a body": b"POST /api/check HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nContent-Length: 9\r\n\r\n",
    "a long body": b"GET / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nContent-Length: 9000\r\n\r\nx",
    "an unread response": b"GET /static/vendor/uplot/uPlot.esm.js HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n"
    * 24,
}


@pytest.mark.parametrize("behaviour", WAITING)
def test_connections_without_the_token_lock_out_no_page(served: PanelProcess, behaviour: str) -> None:
    text = WAITING[behaviour].replace(b"{port}", str(served.port).encode())
    with ExitStack() as stack:
        for _ in range(MAX_CONNECTIONS + 4):
            connection = stack.enter_context(socket.socket())
            # A response that is not read soon fills this buffer; the default one takes megabytes.
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            connection.connect(("127.0.0.1", served.port))
            with suppress(OSError):
                connection.setblocking(False)
                connection.send(text)
        time.sleep(0.5)
        began_s = time.monotonic()
        assert httpx.get(served.origin + "/", timeout=5.0).status_code == 200
        assert served.request("GET", "/api/hello").status_code == 200
        asyncio.run(_connected(served))
        assert time.monotonic() - began_s < 5.0  # on a busy machine
        # And none of them stays.
        # A busy machine takes long to write the responses that fit into the buffers: 200 MB.
        until(
            lambda: not _connections(served), "they were closed", RESPONSE_TIMEOUT_S + HEADER_TIMEOUT_S + 30.0
        )


async def _connected(served: PanelProcess) -> None:
    async with page(served) as it:
        await it.until(lambda page: page.state() == "HOLD")


def _connections(served: PanelProcess) -> int:
    """Connections that a panel keeps."""
    found = psutil.Process(served.process.pid).net_connections("tcp")
    return sum(each.status == psutil.CONN_ESTABLISHED for each in found)


def test_a_read_only_panel_gives_no_order(running: Running) -> None:
    async def attempts(served: PanelProcess) -> None:
        async with page(served) as it:
            await it.until(lambda page: page.state() == "HOLD")
            assert it.newest["hello"]["read_only"]
            for verb in (
                "acquire",
                "resume",
                "hold",
                "clear_fault",
                "goto",
                "jog",
                "play",
                "pose",
                "save_pose",
                "record",
                "release",
            ):
                reply = await it.order(verb)
                assert reply["error"]["code"] == "refused", verb

    with panel(running, "--read-only") as served:
        asyncio.run(attempts(served))
        assert served.request("POST", "/api/check", content=b"t_s,x_mm,y_mm\n").status_code == 403
