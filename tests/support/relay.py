"""A TCP relay that can fall silent: it then takes bytes and passes none on, as a cut link does."""

from __future__ import annotations

import queue
import socket
import threading
import time
from contextlib import suppress
from types import TracebackType
from typing import Self

CHUNK = 1 << 16


class Relay:
    """From a port of this machine to another; `cut` makes it silent, `restore` passes on what waited.

    Args:
        port: to which it connects.
        delay_s: of every byte, in both directions.
    """

    def __init__(self, port: int, delay_s: float = 0.0) -> None:
        self._target = port
        self._delay_s = delay_s
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listening.getsockname()[1]
        self._open = threading.Event()
        self._open.set()
        self._sockets: list[socket.socket] = []
        self._threads = [threading.Thread(target=self._accept)]
        self._threads[0].start()

    def cut(self) -> None:
        """Pass nothing on from now; connections stay."""
        self._open.clear()

    def restore(self) -> None:
        """Pass on again, first what waited."""
        self._open.set()

    def __enter__(self) -> Self:
        """Close on leaving."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close every connection."""
        self._open.set()
        self._listening.shutdown(socket.SHUT_RDWR)
        self._listening.close()
        for each in tuple(self._sockets):
            _shut(each)
        for thread in tuple(self._threads):
            thread.join(5.0)

    def _accept(self) -> None:
        while True:
            try:
                near, _ = self._listening.accept()
            except OSError:
                return
            try:
                far = socket.create_connection(("127.0.0.1", self._target))
            except OSError:  # nothing listens behind it now
                near.close()
                continue
            self._sockets += (near, far)
            for pair in ((near, far), (far, near)):
                waiting: queue.SimpleQueue[tuple[float, bytes]] = queue.SimpleQueue()
                for part in (
                    threading.Thread(target=self._take, args=(pair[0], waiting)),
                    threading.Thread(target=self._pass_on, args=(waiting, pair[1])),
                ):
                    self._threads.append(part)
                    part.start()

    def _take(self, source: socket.socket, waiting: queue.SimpleQueue[tuple[float, bytes]]) -> None:
        try:
            while data := source.recv(CHUNK):
                waiting.put((time.monotonic() + self._delay_s, data))
        except OSError:
            pass
        finally:
            waiting.put((0.0, b""))

    def _pass_on(self, waiting: queue.SimpleQueue[tuple[float, bytes]], target: socket.socket) -> None:
        try:
            while (due := waiting.get())[1]:
                time.sleep(max(due[0] - time.monotonic(), 0.0))
                self._open.wait()
                target.sendall(due[1])
        except OSError:
            pass
        finally:
            self._open.wait()
            _shut(target)


def _shut(connected: socket.socket) -> None:
    with suppress(OSError):
        connected.shutdown(socket.SHUT_RDWR)
    connected.close()
