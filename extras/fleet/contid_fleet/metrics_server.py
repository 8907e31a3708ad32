"""``contid fleet serve --metrics``: the page for Prometheus, on a loopback address of this machine only."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Final

from contid.errors import ContidError
from contid_fleet.endpoints import is_loopback
from contid_fleet.metrics_text import CONTENT_TYPE

#: Bytes of a request, and the time in which it must come.
MAX_REQUEST: Final = 8192
REQUEST_TIMEOUT_S: Final = 2.0
#: Requests that are answered at a time.
MAX_REQUESTS: Final = 8


def metrics_address(text: str) -> tuple[str, int]:
    """Host and port of ``127.0.0.1:9464``.

    Raises:
        ContidError: it is no loopback address with a port: there is no TLS.
    """
    host, _, port = text.rpartition(":")
    if not is_loopback(host) or not port.isdecimal() or not 0 < int(port) < 65536:
        raise ContidError(
            f"{text!r}: a loopback address and a port are expected, such as 127.0.0.1:9464; the page has no "
            "TLS, so other machines read it through one that does (a collector on this machine, SSH)"
        )
    return host.strip("[]"), int(port)


class MetricsServer:
    """Answers ``GET /metrics``; use `start` and `close`.

    Args:
        page: makes the page.
    """

    def __init__(self, page: Callable[[], Awaitable[str]]) -> None:
        self._page = page
        self._places = asyncio.Semaphore(MAX_REQUESTS)
        self._server: asyncio.Server | None = None

    async def start(self, host: str, port: int) -> None:
        """Listen.

        Raises:
            ContidError: another program listens there.
        """
        try:
            self._server = await asyncio.start_server(self._serve, host, port, limit=MAX_REQUEST)
        except OSError as error:
            message = f"--metrics {host}:{port}: cannot listen there: {error.strerror}"
            raise ContidError(message) from error

    def close(self) -> None:
        """Stop listening."""
        if self._server is not None:
            self._server.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with suppress(OSError, TimeoutError, asyncio.IncompleteReadError, asyncio.LimitOverrunError):
            async with asyncio.timeout(REQUEST_TIMEOUT_S), self._places:
                head = await reader.readuntil(b"\r\n\r\n")
                status, body = await self._answer(head)
                lines = (
                    f"HTTP/1.1 {status}",
                    f"Content-Type: {CONTENT_TYPE}",
                    f"Content-Length: {len(body)}",
                    "Connection: close",
                )
                writer.write("\r\n".join(lines).encode() + b"\r\n\r\n" + body)
                await writer.drain()
        writer.close()

    async def _answer(self, head: bytes) -> tuple[str, bytes]:
        """Status and body."""
        first, *fields = head.decode("latin-1").split("\r\n")
        headers = (each.partition(":") for each in fields)
        hosts = [value.strip() for name, _, value in headers if name.lower() == "host"]
        if not all(map(_is_own, hosts)):  # a web page that leads its own name to this machine
            return "421 Misdirected Request", b"asked for another host\n"
        method, _, rest = first.partition(" ")
        if rest.split(" ")[0].partition("?")[0] != "/metrics":
            return "404 Not Found", b"the page is /metrics\n"
        if method != "GET":
            return "405 Method Not Allowed", b"only GET\n"
        return "200 OK", (await self._page()).encode()


def _is_own(host: str) -> bool:
    """True for a loopback address or ``localhost``, with or without a port."""
    name = host if host.endswith("]") else host.rpartition(":")[0] or host
    return name == "localhost" or is_loopback(name)
