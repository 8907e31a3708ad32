"""One connection on a socket pair: every request gets a response."""

from __future__ import annotations

import asyncio
import errno
import json
import socket
from typing import Any, cast

import pytest

from contid.remote.server.connection import Connection
from contid.remote.server.request_handler import RequestHandler


class FailingHandler:
    """A handler on a host without space."""

    @property
    def queries(self) -> FailingHandler:
        return self

    def hello(self) -> dict[str, Any]:
        return {"event": "hello"}

    async def serve(self, caller: object, fields: object) -> dict[str, Any]:
        raise OSError(errno.ENOSPC, "No space left on device")


def test_a_request_that_fails_with_any_error_is_answered(caplog: pytest.LogCaptureFixture) -> None:
    async def ask() -> list[dict[str, Any]]:
        server, client = socket.socketpair()
        client.setblocking(False)
        reader, writer = await asyncio.open_unix_connection(sock=server)
        connection = Connection(1, reader, writer, cast(RequestHandler, FailingHandler()), asyncio.Lock())
        run = asyncio.create_task(connection.run())
        loop = asyncio.get_running_loop()
        received = b""
        for number in (1, 2):
            await loop.sock_sendall(client, b'{"id":%d,"verb":"end","move":1}\n' % number)
        while received.count(b"\n") < 3:
            received += await asyncio.wait_for(loop.sock_recv(client, 1 << 16), 5.0)
        client.close()
        await run
        return [json.loads(line) for line in received.splitlines()]

    _, first, second = asyncio.run(ask())
    assert (first["id"], second["id"]) == (1, 2)
    assert first["ok"] is False
    assert first["error"]["code"] == "internal"
    assert "No space left on device" in first["error"]["message"]
    assert "a request of client 1 failed" in caplog.text
