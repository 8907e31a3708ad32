"""The ends of the control process: the keeper of a bus, and the socket to its bus process."""

from __future__ import annotations

import json
import logging
import os
import select
import signal
import socket
import time
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from contid.control.process.isolation import keeper
from contid.control.process.isolation.wire import HEAD, LONGEST, BusRequest

#: Longest wait for a keeper that ends its bus process, and what that has started.
CLOSE_S: Final = 2.0
#: Flags of a thread that ends, writes a core, or got a deadly signal (linux/sched.h; proc_pid_stat, field 9).
_ENDING: Final = 0x4 | 0x200 | 0x400


class KeptProcess:
    """A keeper and the bus process that it has forked, if any; at most one request is under way.

    Attributes:
        ended: how the bus process ended, "" while it runs.
        cut: the bus process has closed its end of the socket; why comes from its keeper, perhaps later.
        began_s: when the newest request was sent.
    """

    def __init__(self, bus: str, body: bytes) -> None:
        """Fork the keeper; ``body`` is what builds the bus."""
        self.ended = ""
        self.cut = False
        self.began_s = 0.0
        self._bus = bus
        self._keeper, self._orders = keeper.start(f"contid.bus.{bus}", body)
        self._connection: socket.socket | None = None
        self._number = 0
        self._pid = 0

    def start_process(self) -> None:
        """Let the keeper fork a bus process, and end one that is there."""
        if self._connection is not None:
            self._connection.close()
        self._connection, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._connection.setblocking(False)
        while select.select([self._orders], (), (), 0.0)[0] and self._news():  # of the one before
            pass
        self.ended, self.cut, self._pid = "", False, 0
        with theirs, suppress(OSError):
            socket.send_fds(self._orders, [keeper.OPEN], [theirs.fileno()])

    def is_ending(self) -> bool:
        """True when the bus process ends or has ended, also before its socket closes.

        The kernel closes it after the memory was given back and a core was written: 10 to 100 ms on a busy
        machine, which is longer than a stall may last.
        """
        flags = 0
        with suppress(OSError):  # it is gone meanwhile, and the next look finds its socket closed
            for thread in Path(f"/proc/{self._pid}/task").iterdir() if self._pid else ():
                flags |= int((thread / "stat").read_text().rpartition(")")[2].split()[6])
        return self.cut or bool(flags & _ENDING)

    def end_process(self, why: str) -> None:
        """Let the keeper end the bus process."""
        with suppress(OSError):
            self._orders.send(keeper.END, socket.MSG_DONTWAIT)
        self.ended = why

    def close(self, timeout_s: float) -> None:
        """Close the bus, and end its process and its keeper, at once when the bus does not answer in time."""
        if self._orders.fileno() < 0:
            return
        if self._connection is not None:
            if not self.ended:
                self.send(BusRequest.CLOSE)
                self.ask(timeout_s)
            self._connection.close()
        self._orders.close()
        end_s = time.monotonic() + CLOSE_S
        while os.waitpid(self._keeper, os.WNOHANG)[0] == 0:
            if time.monotonic() > end_s:
                os.kill(self._keeper, signal.SIGKILL)
                os.waitpid(self._keeper, 0)
                return
            time.sleep(0.002)

    def next_number(self) -> int:
        """The number of a request that is sent now; answers to earlier ones are not taken any more."""
        self._number = (self._number + 1) & 0xFFFFFFFF
        self.began_s = time.monotonic()
        return self._number

    def send(self, kind: BusRequest) -> None:
        """Send a request without parameters."""
        has_json = False
        self.write(HEAD.pack(kind, self.next_number(), has_json))

    def write(self, message: bytes) -> None:
        """Send a message; that the bus process has ended is reported by its keeper."""
        with suppress(OSError):
            if self._connection is not None:
                self._connection.send(message)

    def ask(self, timeout_s: float) -> dict[str, Any] | None:
        """The JSON answer to the newest request, None without one."""
        message = self.receive(None, time.monotonic() + timeout_s)
        return json.loads(message) if message else None

    def receive(self, kind: BusRequest | None, end_s: float) -> bytes:
        """The answer to the newest request; empty when none came in time or the bus process ended.

        Args:
            kind: `BusRequest.JOB` for the reply to a job; None for the answer to any other request.
            end_s: until when to wait, on the monotonic clock.
        """
        watched = [self._orders]
        if self._connection is not None and not self.cut:
            watched.append(self._connection)
        while not self.ended:
            ready = select.select(watched, (), (), max(end_s - time.monotonic(), 0.0))[0]
            if not ready:
                return b""
            if self._connection in ready:
                message = self._message()
                if not message:
                    self.cut = True
                    watched.remove(self._connection)
                    continue
                found, number, _ = HEAD.unpack_from(message)
                # The first job of a bus process that was started anew builds the bus. Where that fails,
                # `BusProcess` answers it with OPEN and the error.
                if number == self._number and found == BusRequest.OPEN and kind is BusRequest.JOB:
                    self.end_process(json.loads(message[HEAD.size :])["error"])
                elif number == self._number:
                    return message[HEAD.size :]
            if self._orders in ready:
                self._news()
        return b""

    def _message(self) -> bytes:
        """A message of the bus process; empty when it has closed its end."""
        assert self._connection is not None
        with suppress(OSError):
            return self._connection.recv(LONGEST)
        return b""

    def _news(self) -> bool:
        """Take over a message of the keeper; False when it is gone."""
        message = b""
        with suppress(OSError):
            message = self._orders.recv(LONGEST)
        if not message:
            self.ended = self.ended or "has lost its keeper"
            return False
        news = json.loads(message)
        if "pid" in news:
            self._pid = news["pid"]
        elif "ended" in news:
            self.ended = self.ended or news["ended"]
        else:
            level, logger, text = news["log"]
            logging.getLogger(logger).log(level, "%s: %s", self._bus, text)
        return True
