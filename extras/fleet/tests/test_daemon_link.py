"""The connection of the bridge to a daemon: how it ends, and with which reason."""

from __future__ import annotations

import asyncio
import tempfile
from contextlib import suppress
from pathlib import Path

import pytest

from contid.remote.protocol.wire import PROTOCOL, ConnectionLostError, encode
from contid_fleet.links.daemon_link import DaemonLink


@pytest.mark.parametrize(
    ("sent", "reason"),
    [
        (b"no JSON\n", "a line of the daemon cannot be read: not a JSON object"),
        (b"[1]\n", "a line of the daemon cannot be read: an object is expected"),
        (b"", "the daemon closed the connection"),
    ],
)
async def test_the_reason_of_an_end_is_that_of_its_requests(sent: bytes, reason: str) -> None:
    """A line that cannot be read ends the connection for the daemon too, so that its robots hold."""
    link_ended, daemon_saw_end = asyncio.Event(), asyncio.Event()

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(encode({"protocol": PROTOCOL}))
        await reader.readline()
        with suppress(OSError):
            if sent:
                writer.write(sent)
                await reader.read()
            writer.close()
            await writer.wait_closed()
        daemon_saw_end.set()

    with tempfile.TemporaryDirectory(prefix="contid-") as folder:
        path = Path(folder) / "s"
        async with await asyncio.start_unix_server(serve, path):
            link = DaemonLink(path, lambda line, fields: None, link_ended.set)
            await link.connect()
            with pytest.raises(ConnectionLostError, match=reason):
                await link.request("status", {})
            async with asyncio.timeout(60.0):
                await link_ended.wait()
                await daemon_saw_end.wait()
            assert not link.open
            link.close()
