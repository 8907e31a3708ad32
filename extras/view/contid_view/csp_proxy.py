"""The page of the web viewer and its data, served on one loopback port to the holder of a token.

Rerun's page loads a font from Google and reports usage statistics by default, and its servers answer every
local user and every site that a browser shows. This proxy stands before both: the address with the token sets
a cookie, every other request needs it, the names of host and origin must be its own (a site whose name is
made to lead here is refused), connections and waits are bounded, and under its content security policy a
browser refuses every other address.
"""

from __future__ import annotations

import asyncio
import secrets
import threading
from collections.abc import Coroutine, Mapping
from contextlib import suppress
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any, Final, TypeVar
from urllib.parse import parse_qs, quote, urlsplit

_Result = TypeVar("_Result")

LOOPBACK: Final = "127.0.0.1"
#: Connections at the same time; a browser opens six and one for the data.
MAX_CONNECTIONS: Final = 32
#: Longest wait for a request, and for the next bytes of a browser that reads the page.
REQUEST_TIMEOUT_S: Final = 10.0
MAX_HEAD_BYTES: Final = 16_384
#: Requests of the viewer for data are some hundred bytes.
MAX_BODY_BYTES: Final = 1 << 20
_PIECE: Final = 1 << 16
#: Paths of Rerun's data service; the others are files of the page.
_DATA_PATHS: Final = "/rerun."
#: Headers that belong to one connection, or that this proxy replaces.
_OWN_HEADERS: Final = frozenset(
    ("connection", "keep-alive", "set-cookie", "content-security-policy", "access-control-allow-origin")
)
#: A browser may run and draw the page, and fetch data from this server only.
POLICY: Final = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval'; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; worker-src 'self' blob:; "
    "connect-src 'self'; form-action 'none'; frame-ancestors 'none'"
)
_FORWARDED: Final = ("accept", "content-type", "content-length", "te", "x-grpc-web", "x-user-agent", "range")


class _RefusedError(Exception):
    """A request that is not forwarded, with its status."""

    def __init__(self, status: HTTPStatus, message: str = "") -> None:
        self.status = status
        super().__init__(message or status.phrase)


@dataclass(frozen=True, slots=True)
class _Request:
    """The head of a request."""

    method: str
    target: str
    headers: Mapping[str, str]

    @property
    def body_bytes(self) -> int:
        """Length of the body.

        Raises:
            _RefusedError: it has none, or is too long.
        """
        length = self.headers.get("content-length", "0")
        if "transfer-encoding" in self.headers or not length.isascii() or not length.isdigit():
            raise _RefusedError(HTTPStatus.LENGTH_REQUIRED)
        # Python makes no number of more than 4300 digits.
        length = length.lstrip("0") or "0"
        if len(length) > len(str(MAX_BODY_BYTES)) or int(length) > MAX_BODY_BYTES:
            raise _RefusedError(HTTPStatus.REQUEST_ENTITY_TOO_LARGE)
        return int(length)


class CspProxy:
    """Forwards Rerun's web server and data server, and adds token, bounds and policy.

    Attributes:
        url: address with the token, which opens the page.
    """

    def __init__(self, port: int, inner_port: int, data_port: int) -> None:
        """Serve ``inner_port``, Rerun's web server, and ``data_port``, its data, on ``port`` (0 for any)."""
        self._inner_port, self._data_port = inner_port, data_port
        self._token = secrets.token_urlsafe(24)
        self._connections: set[asyncio.Task[None]] = set()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="contid-page", daemon=True)
        self._thread.start()
        self._server = self._run(
            asyncio.start_server(self._accept, LOOPBACK, port, limit=MAX_HEAD_BYTES, backlog=MAX_CONNECTIONS)
        )
        self._host = f"{LOOPBACK}:{self._server.sockets[0].getsockname()[1]}"
        #: Cookies are shared by all ports of a host.
        self._cookie = f"contid-{self._host.rpartition(':')[2]}"
        source = quote(f"rerun+http://{self._host}/proxy", safe="")
        self.url = f"http://{self._host}/?token={self._token}&url={source}"

    def close(self) -> None:
        """Stop serving."""
        self._run(self._end())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def _run(self, work: Coroutine[Any, Any, _Result]) -> _Result:
        return asyncio.run_coroutine_threadsafe(work, self._loop).result()

    async def _end(self) -> None:
        self._server.close()
        for task in self._connections:
            task.cancel()
        await asyncio.gather(*self._connections, return_exceptions=True)
        await self._server.wait_closed()

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """One connection: one request and its answer."""
        task = asyncio.current_task()
        assert task is not None
        self._connections.add(task)
        try:
            if len(self._connections) > MAX_CONNECTIONS:
                raise _RefusedError(HTTPStatus.SERVICE_UNAVAILABLE, "too many connections")
            async with asyncio.timeout(REQUEST_TIMEOUT_S):
                request = await _read_request(reader)
                self._admit(request)
                body = await reader.readexactly(request.body_bytes)
            await self._forward(request, body, reader, writer)
        except _RefusedError as refused:
            writer.write(_refusal(refused))
        except (OSError, EOFError, TimeoutError, asyncio.CancelledError):
            pass  # the browser, or the server behind, closed the connection
        finally:
            self._connections.discard(task)
            with suppress(OSError, TimeoutError):
                async with asyncio.timeout(1.0):
                    writer.close()
                    await writer.wait_closed()

    def _admit(self, request: _Request) -> None:
        """Refuse what does not come from the page of this server.

        Raises:
            _RefusedError: another name, another site, or neither token nor cookie.
        """
        headers = request.headers
        if headers.get("host") != self._host:
            raise _RefusedError(
                HTTPStatus.MISDIRECTED_REQUEST, f"open http://{self._host} as contid printed it"
            )
        if headers.get("origin", f"http://{self._host}") != f"http://{self._host}":
            raise _RefusedError(HTTPStatus.FORBIDDEN, "another site's page asks for it")
        given = _cookie(headers.get("cookie", ""), self._cookie)
        if self._has_token(request):
            given = self._token
        if not secrets.compare_digest(given.encode(), self._token.encode()):
            raise _RefusedError(HTTPStatus.FORBIDDEN, "open the whole address that contid printed")

    def _has_token(self, request: _Request) -> bool:
        parts = urlsplit(request.target)
        given = parse_qs(parts.query).get("token", [""])[0]
        return parts.path == "/" and secrets.compare_digest(given.encode(), self._token.encode())

    async def _forward(
        self, request: _Request, body: bytes, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        """Send a request on and copy its answer until one of the two ends it."""
        is_data = request.method == "POST" and request.target.startswith(_DATA_PATHS)
        if not is_data and request.method not in ("GET", "HEAD"):
            raise _RefusedError(HTTPStatus.METHOD_NOT_ALLOWED)
        port = self._data_port if is_data else self._inner_port
        try:
            inner_reader, inner_writer = await asyncio.open_connection(LOOPBACK, port, limit=MAX_HEAD_BYTES)
        except OSError:
            raise _RefusedError(HTTPStatus.BAD_GATEWAY, "the viewer's server has ended") from None
        try:
            target = "/" if self._has_token(request) else request.target
            inner_writer.write(_forwarded(request, target, port) + body)
            writer.write(await self._answer_head(request, inner_reader))
            # A browser sends nothing more: what arrives is its end.
            ended = asyncio.ensure_future(reader.read(1))
            copied = asyncio.ensure_future(_copy(inner_reader, writer))
            try:
                await asyncio.wait((ended, copied), return_when=asyncio.FIRST_COMPLETED)
            finally:
                for each in (ended, copied):
                    each.cancel()
                await asyncio.gather(ended, copied, return_exceptions=True)
        finally:
            inner_writer.close()

    async def _answer_head(self, request: _Request, inner: asyncio.StreamReader) -> bytes:
        """The head of an answer with the headers of this proxy."""
        first, *lines = (await inner.readuntil(b"\r\n\r\n")).decode("latin-1").split("\r\n")[:-2]
        kept = [line for line in lines if line.partition(":")[0].strip().lower() not in _OWN_HEADERS]
        kept += [
            "Connection: close",
            f"Content-Security-Policy: {POLICY}",
            "Referrer-Policy: no-referrer",
            "X-Content-Type-Options: nosniff",
        ]
        if self._has_token(request):
            kept.append(f"Set-Cookie: {self._cookie}={self._token}; Path=/; HttpOnly; SameSite=Strict")
        return "\r\n".join([first, *kept, "", ""]).encode("latin-1")


async def _read_request(reader: asyncio.StreamReader) -> _Request:
    """The head of a request.

    Raises:
        _RefusedError: it is no request, or has a header twice.
    """
    try:
        head = (await reader.readuntil(b"\r\n\r\n")).decode("ascii")
        first, *lines = head.split("\r\n")[:-2]
        method, target, _ = first.split(" ")
        pairs = [(name.lower(), value.strip()) for name, _, value in (line.partition(":") for line in lines)]
    except asyncio.LimitOverrunError as error:
        raise _RefusedError(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE) from error
    except ValueError as error:  # not ASCII, or another first line
        raise _RefusedError(HTTPStatus.BAD_REQUEST) from error
    if len(dict(pairs)) != len(pairs) or not target.startswith("/"):
        raise _RefusedError(HTTPStatus.BAD_REQUEST)
    return _Request(method, target, dict(pairs))


def _cookie(header: str, name: str) -> str:
    """The value of a cookie, "" when it was not sent."""
    pairs = (each.strip().partition("=") for each in header.split(";"))
    return next((value for key, _, value in pairs if key == name), "")


def _forwarded(request: _Request, target: str, port: int) -> bytes:
    lines = [f"{request.method} {target} HTTP/1.1", f"Host: {LOOPBACK}:{port}", "Connection: close"]
    lines += [f"{name}: {request.headers[name]}" for name in _FORWARDED if name in request.headers]
    return "\r\n".join([*lines, "", ""]).encode()


def _refusal(refused: _RefusedError) -> bytes:
    body = f"contid: {refused}\n".encode()
    head = (
        f"HTTP/1.1 {refused.status.value} {refused.status.phrase}\r\nContent-Type: text/plain\r\n"
        f"Content-Length: {len(body)}\r\nConnection: close\r\nCache-Control: no-store\r\n\r\n"
    )
    return head.encode() + body


async def _copy(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Copy until the end; a browser that takes nothing for `REQUEST_TIMEOUT_S` is given up."""
    while piece := await reader.read(_PIECE):
        writer.write(piece)
        async with asyncio.timeout(REQUEST_TIMEOUT_S):
            await writer.drain()
