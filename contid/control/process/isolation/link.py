"""The control process's ends of a kept process: the socket to its keeper, and the socket to itself.

A keeper is forked once and outlives its processes, of which it has one at a time:

    state    of the kept process                               leads to
    ABSENT   none was started                                  RUNS: `start_process`
    RUNS     it has its end of the socket                      CUT: it closes that; ENDED: as CUT
    CUT      its end is closed, and why is not known yet       ENDED: report or end of its keeper, or ours
    ENDED    `how_ended` has why                               RUNS: `start_process`
"""

from __future__ import annotations

import enum
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
from contid.control.process.isolation.served_process import ServedProcess
from contid.control.process.isolation.wire import HEAD, LONGEST, KeptAnswer, RequestKind

#: Longest wait for a keeper that ends its process, and what that has started.
CLOSE_S: Final = 2.0
#: Flags of a thread that ends, writes a core, or got a deadly signal (linux/sched.h; proc_pid_stat, field 9).
_ENDING: Final = 0x4 | 0x200 | 0x400
#: The number of a request that has no answer, or whose answer is not taken.
_UNANSWERED: Final = 0


class ProcessState(enum.Enum):
    """The states of a kept process; the table is above."""

    ABSENT = enum.auto()
    RUNS = enum.auto()
    CUT = enum.auto()
    ENDED = enum.auto()


class KeptProcess:
    """A keeper and its process; at most one request waits for its answer.

    Attributes:
        state: of the process.
        pid: of the process, 0 until its keeper has reported it.
        how_ended: why it is in `ProcessState.ENDED`.
        requested_s: when the newest request that has an answer was sent, on the monotonic clock.
    """

    def __init__(self, name: str, served: type[ServedProcess], body: bytes) -> None:
        """Fork the keeper.

        Args:
            name: of the bus, or of the robot whose model it is; for logs.
            served: what the process serves.
            body: what builds the bus or the model.
        """
        self.state = ProcessState.ABSENT
        self.how_ended = ""
        self.requested_s = 0.0
        self.pid = 0
        self._name = name
        self._logger = f"contid.{served.what}.{name}"
        self._keeper, self._orders = keeper.start(self._logger, served, body)
        self._connection: socket.socket | None = None
        self._number = _UNANSWERED

    # -- the process -------------------------------------------------------------------------------------

    def start_process(self) -> None:
        """Let the keeper fork a process, and end one that is there."""
        if self._connection is not None:
            self._connection.close()
        self._connection, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._connection.setblocking(False)
        while select.select([self._orders], (), (), 0.0)[0] and self._take_report():  # of the one before
            pass
        self.state, self.pid, self.how_ended = ProcessState.RUNS, 0, ""
        with theirs, suppress(OSError):
            socket.send_fds(self._orders, [keeper.OPEN], [theirs.fileno()])

    def is_ending(self) -> bool:
        """True when the process ends or has ended, also before its socket closes.

        The kernel closes it after the memory was given back and a core was written: 10 to 100 ms on a busy
        machine, which is longer than a stall may last.
        """
        flags = 0
        with suppress(OSError):  # it is gone meanwhile, and the next look finds its socket closed
            for thread in Path(f"/proc/{self.pid}/task").iterdir() if self.pid else ():
                flags |= int((thread / "stat").read_text().rpartition(")")[2].split()[6])
        return self.state is ProcessState.CUT or bool(flags & _ENDING)

    def end_process(self, why: str) -> None:
        """Let the keeper end the process."""
        with suppress(OSError):
            self._orders.send(keeper.END, socket.MSG_DONTWAIT)
        self.state, self.how_ended = ProcessState.ENDED, why

    def close(self, timeout_s: float) -> None:
        """Close what is served, and end process and keeper, at once when it does not answer in time."""
        if self._orders.fileno() < 0:
            return
        if self._connection is not None:
            if self.state is not ProcessState.ENDED:
                self.request(RequestKind.CLOSE)
                self.answer(timeout_s)
            self._connection.close()
        self._orders.close()
        end_s = time.monotonic() + CLOSE_S
        while os.waitpid(self._keeper, os.WNOHANG)[0] == 0:
            if time.monotonic() > end_s:
                os.kill(self._keeper, signal.SIGKILL)
                os.waitpid(self._keeper, 0)
                return
            time.sleep(0.002)

    # -- requests and answers ----------------------------------------------------------------------------

    def request(self, kind: RequestKind, body: bytes = b"") -> None:
        """Send a request; answers to earlier ones are not taken any more."""
        self._number = self._number % 0xFFFFFFFF + 1
        self.requested_s = time.monotonic()
        self._send(kind, self._number, body)

    def send_unanswered(self, kind: RequestKind, body: bytes) -> None:
        """Send a request whose answer is not taken, without regard to one that waits for its answer."""
        self._send(kind, _UNANSWERED, body)

    def _send(self, kind: RequestKind, number: int, body: bytes) -> None:
        with suppress(OSError):  # that the process has ended is reported by its keeper
            if self._connection is not None:
                self._connection.send(HEAD.pack(kind, number) + body)

    def answer_json(self, timeout_s: float) -> dict[str, Any] | None:
        """The JSON of an `answer`."""
        answer = self.answer(timeout_s)
        return None if answer is None else json.loads(answer.body)

    def answer(self, timeout_s: float) -> KeptAnswer | None:
        """The answer to the newest request; None when none came in time or the process has ended."""
        end_s = time.monotonic() + timeout_s
        while self.state is not ProcessState.ENDED:
            watched = [self._orders]
            if self._connection is not None and self.state is ProcessState.RUNS:
                watched.append(self._connection)
            ready = select.select(watched, (), (), max(end_s - time.monotonic(), 0.0))[0]
            if not ready:
                return None
            message = b""
            if self._connection is not None and self._connection in ready:
                message = _received(self._connection)
                if not message:
                    self.state = ProcessState.CUT
            if self._orders in ready:
                self._take_report()
            if message:
                kind, number = HEAD.unpack_from(message)
                if number == self._number:
                    return KeptAnswer(RequestKind(kind), message[HEAD.size :])
        return None

    def _take_report(self) -> bool:
        """Take over what the keeper reports; False when it is gone."""
        message = _received(self._orders)
        report: dict[str, Any] = json.loads(message) if message else {"ended": "has lost its keeper"}
        if "pid" in report:
            self.pid = report["pid"]
        elif "log" in report:
            level, logger, text = report["log"]
            logging.getLogger(logger).log(level, "%s: %s", self._name, text)
        elif report.get("of", self.pid) != self.pid:  # one before, whose end was noticed before its report
            logging.getLogger(self._logger).warning("%s: its process %s", self._name, report["ended"])
        elif self.state is not ProcessState.ENDED:
            self.state, self.how_ended = ProcessState.ENDED, report["ended"]
        return bool(message)


def _received(connection: socket.socket) -> bytes:
    """A message; empty when the other end is closed."""
    with suppress(OSError):
        return connection.recv(LONGEST)
    return b""
