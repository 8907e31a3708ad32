"""The winch box in software, for use without hardware and for the contract tests."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Final

from contid.hal import AxisOnBus
from contid_winch import BusOptions
from contid_winch.link import drum_of

#: Of every drum [steps/s].
SPEED: Final = 8000.0
WATCHDOG: Final = "watchdog"


@dataclass
class Drum:
    """One drum: it goes to its goal at one speed, while it has power.

    Attributes:
        position, goal: [steps].
        state: ``on``, ``held``, ``off`` or the name of a latched fault.
        cause: why the fault cannot be cleared yet, "" for no reason.
        silent: it does not answer the box.
    """

    position: float = 0.0
    goal: float = 0.0
    state: str = "off"
    cause: str = ""
    silent: bool = False

    def advance(self, seconds: float) -> None:
        """Move for a time [s]."""
        if self.state == "on":
            way = self.goal - self.position
            self.position += max(-SPEED * seconds, min(SPEED * seconds, way))

    def rest(self, state: str) -> None:
        """Stop where it is."""
        self.state, self.goal = state, self.position


class Box:
    """A box with its drums, listening at an address from `plug` to `unplug`; a context manager does both."""

    def __init__(self, address: tuple[str, int], drums: Sequence[int]) -> None:
        self.drums = {drum: Drum() for drum in drums}
        self.address = address
        self._lock = threading.Lock()
        self._watchdog_s = 0.1
        self._now = self._fed = time.monotonic()
        self._sockets: list[socket.socket] = []
        self._thread: threading.Thread | None = None

    def __enter__(self) -> Box:
        self.plug()
        return self

    def __exit__(self, *_: object) -> None:
        self.unplug()

    def plug(self) -> None:
        """Connect the network cable."""
        listener = socket.create_server(self.address)
        self.address = listener.getsockname()[:2]
        self._sockets = [listener]
        self._thread = threading.Thread(target=self._serve, args=(listener,), name="winch box")
        self._thread.start()

    def unplug(self) -> None:
        """Pull the network cable; drums keep their power, and the watchdog counts on."""
        for each in reversed(self._sockets):
            with suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)  # wakes the thread that waits in it
            each.close()
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    @contextmanager
    def locked_drums(self) -> Iterator[dict[int, Drum]]:
        """The drums as they are now, locked against the server thread."""
        with self._lock:
            self._advance()
            yield self.drums

    def _advance(self) -> None:
        now = time.monotonic()
        trip = self._fed + self._watchdog_s
        for drum in self.drums.values():
            powered = drum.state == "on"
            drum.advance(min(now, trip) - self._now if powered else 0.0)
            if powered and now > trip:
                drum.rest(WATCHDOG)
        self._now = now

    def _serve(self, listener: socket.socket) -> None:
        with suppress(OSError):  # the cable
            while True:
                line, _ = listener.accept()
                self._sockets[1:] = [line]
                line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                with (
                    suppress(OSError),
                    line,
                    line.makefile("r", encoding="ascii", errors="replace") as requests,
                ):
                    for request in requests:
                        number, *message = request.split()
                        with self.locked_drums():
                            answer = self._answer(message)
                        line.sendall(f"{number} {answer}\n".encode())

    def _answer(self, message: list[str]) -> str:
        verb, *rest = message
        answering = {drum: each for drum, each in self.drums.items() if not each.silent}
        if verb == "hello":
            return " ".join(["winch", "1", *(str(drum) for drum in answering)])
        if verb == "watchdog":
            self._watchdog_s = float(rest[0]) / 1e3
        elif verb == "x":
            self._fed = self._now
            for item in rest:
                drum, _, goal = item.partition("=")
                if int(drum) in answering and answering[int(drum)].state == "on":
                    answering[int(drum)].goal = float(goal)
            return " ".join(f"{n}={each.position:.0f},{each.state}" for n, each in answering.items())
        elif verb == "off":
            for drum in rest[1:]:
                each = answering.get(int(drum))
                if each is not None and each.state in ("on", "held", "off"):
                    each.rest("held" if rest[0] == "hold" else "off")
        else:
            asked = [(drum, answering.get(int(drum))) for drum in rest]
            for drum, each in asked:
                if each is None:
                    return f"no {drum} does not answer"
                if each.cause or (verb == "on" and each.state == WATCHDOG):
                    return f"no {drum} {each.cause or each.state}"
            for _, each in asked:
                if each is not None:
                    each.rest("on" if verb == "on" else "off")
            self._fed = self._now
        return "ok"


@contextmanager
def emulated(options: BusOptions, axes: Sequence[AxisOnBus]) -> Iterator[Sequence[str]]:
    """The box of one bus at the address of its options; every drum begins in the middle of its travel."""
    from contid_winch.bus import rad_per_step

    with Box(options.host_and_port, [drum_of(axis) for axis in axes]) as box:
        with box.locked_drums() as drums:
            for axis in axes:
                low, high = axis.travel or (0.0, 0.0)
                drums[drum_of(axis)].position = round((low + high) / 2.0 / rad_per_step(axis))
        yield [f"winch box at {options.address}: drums {', '.join(str(drum) for drum in drums)}"]
