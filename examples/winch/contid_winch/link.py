"""The network line to a winch box: one numbered request, one answer with its number, or a time-out.

Requests, and the answers after ``NUMBER``; drums that do not answer the box are left out::

    hello                     winch 1 DRUM...
    watchdog MS               ok
    x [DRUM=GOAL]...          DRUM=POSITION,STATE...    goals and positions in steps; feeds the watchdog
    on DRUM...                ok                        goal := position, then power
    off hold|relax DRUM...    ok                        stop there, with or without power
    clear DRUM...             ok, or: no DRUM FAULT     never moves, never powers

STATE is ``on``, ``off``, ``held`` or the name of a latched fault.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Sequence

from contid.errors import DeviceLostError, DeviceNotFoundError
from contid.hal import AxisOnBus
from contid_winch import AxisOptions, BusOptions


def drum_of(axis: AxisOnBus) -> int:
    """Number of the drum an axis is wound on."""
    assert isinstance(axis.options, AxisOptions)
    return axis.options.drum


class Link:
    """An open line to a box that has every drum it should have."""

    def __init__(self, name: str, options: BusOptions, axes: Sequence[AxisOnBus]) -> None:
        """Connect and shake hands; changes no drum.

        Raises:
            DeviceNotFoundError: no answer, another device, or missing drums.
        """
        self._name = name
        self._reply_s = options.reply_ms / 1e3
        self._number = 0
        self._unread = b""
        try:
            self._socket = socket.create_connection(options.host_and_port, timeout=1.0)
        except OSError as error:
            remedy = "check that the box is on, and its address in the robot file"
            raise DeviceNotFoundError(name, f"cannot reach {options.address}: {error}", remedy) from error
        try:
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._shake_hands(options, axes)
        except BaseException:
            self.close()
            raise

    def _shake_hands(self, options: BusOptions, axes: Sequence[AxisOnBus]) -> None:
        greeting = (self.ask("hello") or "nothing").split()
        if greeting[:2] != ["winch", "1"]:
            message = f"{options.address} is no winch box of version 1; its hello: {' '.join(greeting)!r}"
            raise DeviceNotFoundError(self._name, message)
        missing = [
            f"{axis.name} (drum {drum_of(axis)})" for axis in axes if str(drum_of(axis)) not in greeting[2:]
        ]
        if missing:
            message = (
                f"no answer from {', '.join(missing)}; the box has drums {', '.join(greeting[2:]) or 'none'}"
            )
            raise DeviceNotFoundError(self._name, message, "check the drum's cable and its number")
        if self.ask(f"watchdog {options.watchdog_ms}") != "ok":
            raise DeviceNotFoundError(self._name, f"the box refuses a watchdog of {options.watchdog_ms} ms")

    def ask(self, request: str) -> str | None:
        """The answer to a request, None if none came in time.

        Raises:
            DeviceLostError: the line is cut.
        """
        self._number += 1
        ours = str(self._number)
        deadline = time.monotonic() + self._reply_s
        try:
            self._socket.sendall(f"{ours} {request}\n".encode())
            while (left := deadline - time.monotonic()) > 0:
                self._socket.settimeout(left)
                received = self._socket.recv(4096)
                if not received:
                    raise DeviceLostError(self._name, "the box closed the line", "is it switched on?")
                *lines, self._unread = (self._unread + received).split(b"\n")
                for line in lines:
                    number, _, answer = line.decode("ascii", "replace").partition(" ")
                    if number == ours:  # others answer requests that timed out
                        return answer
        except TimeoutError:
            return None
        except OSError as error:
            raise DeviceLostError(self._name, f"the line is cut: {error}", "check the network") from error
        return None

    def close(self) -> None:
        """Close the connection; idempotent, changes no drum."""
        self._socket.close()
