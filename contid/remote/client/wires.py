"""What carries the lines of a client to a daemon: its Unix socket, or another way that has an address.

An `Address` opens a `Wire` that takes requests and delivers lines, from any thread. Blocking and asyncio
clients read both alike. The network of a fleet is one: ``fleet:FLEET/NODE``.
"""

from __future__ import annotations

import queue
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from contid import entry_points
from contid.remote.client.client_protocol import CHUNK, Request
from contid.remote.protocol.connect import connect


class Wire(Protocol):
    """A connection to a daemon."""

    def send(self, request: Request) -> None:
        """Send a request; its response is delivered as a line."""
        ...

    def close(self) -> None:
        """End the connection; idempotent."""
        ...


class Address(Protocol):
    """Where a daemon is, other than at a socket.

    Attributes:
        name: name in messages.
    """

    name: str

    def open(self, deliver: Callable[[bytes], None]) -> Wire:
        """Connect; ``deliver`` gets lines from any thread, and b"" when the connection has ended.

        Raises:
            ContidError: nothing answers there.
        """
        ...


def address_of(given: object) -> Address | None:
    """The address of a text such as ``fleet:lab/hand1``, None for the path of a socket.

    Raises:
        ContidError: it begins like an address and is none.
    """
    if given is None or not isinstance(given, str | Path):
        return given  # type: ignore[return-value]  # an address, or None
    text = str(given)
    scheme, colon, _ = text.partition(":")
    make = entry_points.load_one(entry_points.ADDRESSES, scheme) if colon else None
    if make is None:
        return None
    found: Address = make(text)
    return found


class SocketWire:
    """The Unix socket of a daemon, blocking."""

    def __init__(self, path: Path, timeout_s: float) -> None:
        self._socket = connect(path, timeout_s)

    def send(self, request: Request) -> None:
        """Send a request; its response is delivered as a line.

        See `Wire.send`; waits for room at most as long as for the response.
        """
        self._socket.settimeout(request.timeout_s)
        try:
            self._socket.sendall(request.line)
        except TimeoutError:  # part of the line may be sent, and the next request would be its rest
            self._socket.shutdown(socket.SHUT_RDWR)
            raise

    def receive(self, timeout_s: float) -> bytes | None:
        """The next bytes, b"" after the end, None when none came in time; 0 does not wait."""
        try:
            self._socket.settimeout(timeout_s)
            return self._socket.recv(CHUNK)
        except (TimeoutError, BlockingIOError):
            return None

    def close(self) -> None:
        """End the connection; idempotent (`Wire.close`)."""
        self._socket.close()


class QueuedWire:
    """The wire of an address, blocking."""

    def __init__(self, address: Address) -> None:
        self._lines: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._wire = address.open(self._lines.put)

    def send(self, request: Request) -> None:
        """Send a request; its response is delivered as a line (`Wire.send`)."""
        self._wire.send(request)

    def receive(self, timeout_s: float) -> bytes | None:
        """The next bytes, b"" after the end, None when none came in time (`SocketWire.receive`)."""
        try:
            return self._lines.get(timeout_s > 0.0, timeout_s)
        except queue.Empty:
            return None

    def close(self) -> None:
        """End the connection; idempotent (`Wire.close`)."""
        self._wire.close()
