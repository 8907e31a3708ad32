"""Real panels before real daemons on simulated devices, and programs that speak to them."""

from __future__ import annotations

import asyncio
import itertools
import json
import math
import re
import subprocess
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress
from dataclasses import dataclass
from typing import Any, Self

import httpx
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed

from contid.remote.protocol.expiry import clock_s
from tests.support.daemons import PIPE_BYTES, Running, command


@dataclass
class PanelProcess:
    """A panel, its address and its token."""

    process: subprocess.Popen[str]
    url: str
    port: int
    token: str

    @property
    def origin(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def request(self, method: str, path: str, **keys: Any) -> httpx.Response:
        """A request as its own page makes it, unless headers are given."""
        headers = {"authorization": f"Bearer {self.token}", "origin": self.origin, **keys.pop("headers", {})}
        given = {name: value for name, value in headers.items() if value is not None}
        return httpx.request(method, self.origin + path, headers=given, timeout=20.0, **keys)


@contextmanager
def panel(running: Running, *arguments: str) -> Iterator[PanelProcess]:
    """`contid panel` on a free port."""
    process = subprocess.Popen(
        command("panel", "--socket", str(running.socket), "--port", "0", *arguments),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        pipesize=PIPE_BYTES,
    )
    assert process.stdout is not None
    try:
        url = process.stdout.readline().strip()
        found = re.fullmatch(r"https?://[^/]*:(\d+)/#([\w-]+)", url)
        assert found is not None, (url, process.communicate(timeout=10)[1])
        yield PanelProcess(process, url, int(found[1]), found[2])
    finally:
        process.terminate()
        _, errors = process.communicate(timeout=20)
        assert "Traceback" not in errors, errors


class PanelClient:
    """What a page does, without a browser."""

    def __init__(self, connection: ClientConnection) -> None:
        self.connection = connection
        self.newest: dict[str, Any] = {}
        self._numbers = itertools.count(1)

    async def message(self) -> dict[str, Any]:
        fields: dict[str, Any] = json.loads(await asyncio.wait_for(self.connection.recv(), 20.0))
        self.newest[fields["kind"]] = fields
        return fields

    async def send(self, verb: str, **fields: Any) -> int:
        number = next(self._numbers)
        message = {"id": number, "verb": verb, "pressed_ms": clock_s() * 1e3, **fields}
        await self.connection.send(json.dumps(message))
        return number

    async def order(self, verb: str, **fields: Any) -> dict[str, Any]:
        """Send an order; its reply."""
        number = await self.send(verb, **fields)
        while True:
            found = await self.message()
            if found["kind"] == "reply" and found["id"] == number:
                return found

    async def close_code(self, *texts: str) -> int | None:
        """Send messages and read until the panel closes the connection; the status it gave."""
        with suppress(ConnectionClosed):
            for text in texts:
                await self.connection.send(text)
        with suppress(ConnectionClosed):
            while True:
                await self.message()
        return self.connection.close_code

    async def until(self, condition: Callable[[Self], Any]) -> None:
        """Read until something is in the newest messages."""
        async with asyncio.timeout(30.0):
            while not condition(self):
                await self.message()

    def holder(self) -> str | None:
        """Who holds the lease; "unknown" before the first status."""
        status = self.newest.get("status")
        found: str | None = "unknown" if status is None else status["status"]["lease"]["holder"]
        return found

    def tip_mm(self, robot: str = "f0") -> list[float]:
        """The tip, not a number before the first frame."""
        frame = self.newest.get("frame")
        found: list[float] | None = None if frame is None else frame["robots"][robot]["tip_mm"]
        return [math.nan] * 3 if found is None else found

    def state(self, robot: str = "f0") -> str | None:
        frame = self.newest.get("frame")
        return None if frame is None else str(frame["robots"][robot]["state"])


@asynccontextmanager
async def page(served: PanelProcess, name: str = "127.0.0.1", **keys: Any) -> AsyncIterator[PanelClient]:
    """A WebSocket as the page opens it; ``keys`` replace what `websockets` sends."""
    keys.setdefault("origin", served.origin)
    keys.setdefault("subprotocols", ["contid.panel", f"contid.token.{served.token}"])
    async with connect(f"ws://{name}:{served.port}/socket", proxy=None, compression=None, **keys) as made:
        yield PanelClient(made)
