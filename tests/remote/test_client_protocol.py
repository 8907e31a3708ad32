"""The client side of the protocol without I/O: lines in their order, whatever the chunks."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contid.remote.client.client_protocol import ClientProtocol, Request
from contid.remote.protocol.wire import Code, ConnectionLostError, RemoteError, encode
from contid_library.async_client import AsyncClient
from contid_library.async_wires import AsyncSocketWire


def response(request: Request, **result: Any) -> bytes:
    return encode({"id": request.number, "ok": True, "result": result})


def credit(move: int, credits: int) -> bytes:
    return encode({"event": "credit", "move": move, "credits": credits})


@given(st.lists(st.integers(1, 40), max_size=8))
def test_lines_mean_the_same_wherever_chunks_are_cut(cuts: list[int]) -> None:
    protocol = ClientProtocol()
    request = protocol.request("status", {})
    line = credit(3, 5) + response(request, tick=7) + encode({"event": "telemetry", "tick": 8})
    for cut in cuts:
        protocol.receive(line[:cut])
        line = line[cut:]
    protocol.receive(line)
    assert protocol.result(request) == {"tick": 7}
    assert list(protocol.new_frames()) == [{"event": "telemetry", "tick": 8}]
    assert protocol.credits == {3: 5}


def test_the_response_to_a_forgotten_request_is_dropped() -> None:
    protocol = ClientProtocol()
    late, request = protocol.request("status", {}), protocol.request("ping", {})
    protocol.forget(late)
    protocol.receive(response(late, tick=1))
    assert protocol.result(late) is None
    refusal = {"id": None, "ok": False, "error": {"code": "bad-request", "message": "what?"}}
    protocol.receive(encode(refusal))
    with pytest.raises(RemoteError, match="what") as refused:
        protocol.result(request)
    assert refused.value.code == Code.BAD_REQUEST


def test_a_daemon_of_another_protocol_is_only_sent_stops() -> None:
    protocol = ClientProtocol()
    greeted = protocol.request("hello", {})
    protocol.receive(encode({"event": "hello", "protocol": 99}))
    with pytest.raises(RemoteError, match="protocol 99"):
        protocol.result(greeted)
    with pytest.raises(RemoteError, match="protocol 99"):
        protocol.request("move", {})
    stop = protocol.request("estop", {})
    protocol.receive(response(stop, tick=1))
    assert protocol.result(stop) == {"tick": 1}


def test_credit_is_that_of_the_newest_line() -> None:
    """A notice before the response to further rows is spent by them."""
    protocol = ClientProtocol()
    begun = protocol.request("move", {"columns": ["x_mm"]})
    protocol.receive(response(begun, move=4, timed=False, credits=8))
    assert protocol.credits[4] == 8
    rows = protocol.request("rows", {"move": 4, "rows": [[1.0]]})
    protocol.receive(credit(4, 4) + response(rows, credits=0, refused=[]))
    assert protocol.credits[4] == 0
    protocol.receive(credit(4, 4))
    assert protocol.credits[4] == 4


def test_the_sum_of_granted_rows_never_falls() -> None:
    """By network a notice may be overtaken by the response to a later row."""
    protocol = ClientProtocol()
    begun = protocol.request("move", {"columns": ["x_mm"]})
    protocol.receive(response(begun, move=4, timed=False, credits=8, granted=8))
    rows = protocol.request("rows", {"move": 4, "rows": [[1.0]]})
    assert protocol.receive(response(rows, credits=7, granted=12, refused=[])), "as a notice does"
    protocol.receive(encode({"event": "credit", "move": 4, "credits": 4, "granted": 10}))
    assert protocol.granted == {4: 12}


def test_a_stopped_move_raises_its_reason() -> None:
    protocol = ClientProtocol()
    assert not protocol.arrived(2)
    protocol.receive(encode({"event": "move", "move": 2, "reached": False, "message": "another client held"}))
    with pytest.raises(RemoteError, match="another client held") as refused:
        protocol.arrived(2)
    assert refused.value.code == Code.STOPPED


def test_a_request_that_waits_ends_with_the_connection(tmp_path: Path) -> None:
    """Another task closes the client: the waiting one need not wait for its time-out of an hour."""

    async def listen(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.read()
        writer.close()

    async def close_while_waiting() -> None:
        silent = await asyncio.start_unix_server(listen, tmp_path / "socket")
        client = AsyncClient(tmp_path / "socket", timeout_s=3600.0)
        await client._open(tmp_path / "socket")
        waiting = asyncio.create_task(client.request("status"))
        await asyncio.sleep(0.0)
        await client._disconnect()
        with pytest.raises(ConnectionLostError, match="this client was closed"):
            await asyncio.wait_for(waiting, 60.0)
        silent.close()
        await silent.wait_closed()

    asyncio.run(close_while_waiting())


def test_a_request_that_cannot_be_sent_ends_in_its_time(tmp_path: Path) -> None:
    """A daemon that is stopped by a signal takes nothing any more; its socket fills."""

    class FullWire:
        async def send(self, request: Request) -> None:
            await asyncio.sleep(3600.0)

    async def ask() -> None:
        client = AsyncClient(tmp_path / "socket", timeout_s=0.05)
        client._waiting, client._wire = {}, cast(AsyncSocketWire, FullWire())
        with pytest.raises(ConnectionLostError, match="no response within"):
            await asyncio.wait_for(client.request("hold"), 60.0)

    asyncio.run(ask())
