"""Accepts clients, also when the process has no descriptor left: a stop always gets in.

One descriptor is kept in reserve. When `accept` fails for want of one, the reserve is given up for the new
client and a client that was idle longest is disconnected; the descriptor it frees is the next reserve.
"""

from __future__ import annotations

import asyncio
import errno
import os
import socket
from collections.abc import Callable
from contextlib import suppress
from typing import Final

#: Clients accepted in one turn of the event loop: each costs a quarter of a millisecond, and requests wait
#: for it. Those that left while they waited cost a tenth of that, so that a full queue shortens.
PER_TURN: Final = 2
LEFT_PER_TURN: Final = 20
#: Pause before the next attempt while there is neither a descriptor nor a reserve.
PAUSE_S: Final = 0.02
_EXHAUSTED: Final = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)


class Acceptor:
    """Accepts the clients of a listening socket until it is closed.

    Args:
        listening: the socket, non-blocking.
        serve: gets every connected socket.
        make_room: disconnects the client that was idle longest.
    """

    def __init__(
        self,
        listening: socket.socket,
        serve: Callable[[socket.socket], None],
        make_room: Callable[[], None],
    ) -> None:
        self._listening = listening
        self._serve = serve
        self._make_room = make_room
        self._loop = asyncio.get_running_loop()
        self._reserve = -1
        self._paused: asyncio.TimerHandle | None = None
        self._refill()
        self._loop.add_reader(listening, self._ready)

    def close(self) -> None:
        """Accept no more."""
        if self._paused is not None:
            self._paused.cancel()
        self._loop.remove_reader(self._listening)
        if self._reserve >= 0:
            os.close(self._reserve)
            self._reserve = -1

    def _ready(self) -> None:
        """Accept the clients that wait."""
        accepted = 0
        for _ in range(LEFT_PER_TURN):
            self._refill()
            try:
                connected = self._accept()
            except (BlockingIOError, InterruptedError, ConnectionAbortedError):
                return
            except OSError as error:
                if error.errno not in _EXHAUSTED:
                    raise
                self._make_room()
                self._pause()
                return
            if _left(connected):
                connected.close()
                continue
            self._serve(connected)
            accepted += 1
            if accepted == PER_TURN:
                return

    def _accept(self) -> socket.socket:
        try:
            return self._listening.accept()[0]
        except OSError as error:
            if error.errno not in _EXHAUSTED or self._reserve < 0:
                raise
        os.close(self._reserve)
        self._reserve = -1
        connected = self._listening.accept()[0]
        self._make_room()
        return connected

    def _refill(self) -> None:
        """Take a descriptor as the reserve, if there is one."""
        if self._reserve < 0:
            try:
                self._reserve = os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC)
            except OSError as error:
                if error.errno not in _EXHAUSTED:
                    raise

    def _pause(self) -> None:
        """Try again later: the socket stays readable and would wake the loop without end."""
        self._loop.remove_reader(self._listening)
        self._paused = self._loop.call_later(PAUSE_S, self._resume)

    def _resume(self) -> None:
        self._paused = None
        self._loop.add_reader(self._listening, self._ready)


def _left(connected: socket.socket) -> bool:
    """True when a client has left without sending anything: no stop is lost with it."""
    with suppress(OSError):  # nothing came yet
        return not connected.recv(1, socket.MSG_PEEK | socket.MSG_DONTWAIT)
    return False
