"""The port of a bus in a process of its own: what the tick has instead of a bus and a worker thread."""

from __future__ import annotations

import json
import logging
import os
import select
import signal
import socket
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any, Final

from contid.control.engine.ports import BusJob, BusPort, BusReply
from contid.control.process.isolation import keeper
from contid.control.process.isolation.wire import HEAD, LONGEST, BusRequest, BusWire
from contid.control.tick.faults import Fault
from contid.control.tick.state import Effect
from contid.errors import ContidError, DriverDefectError
from contid.hal import Rest, Sample, TipMeasured
from contid.hal.isolated import IsolatedBusOptions
from contid.robot_file.document import BusWiring

#: Longest time to open a bus, or to arm, clear or disable its axes.
OPEN_S: Final = 10.0
#: Longest exchange; then the bus process is ended and, at the next attempt to reopen, started again.
HANGS_S: Final = 0.5
#: Longest wait for a keeper that ends its bus process, and what that has started.
CLOSE_S: Final = 2.0
#: Longest wait for the counts of a bus at the end of a run.
COUNTS_S: Final = 0.5

log = logging.getLogger(__name__)


class IsolatedBus:
    """What the control process has of the bus: its name and its axes; it may send, and never waits.

    What only some buses can (`LimitsEffort`, `MeasuresTips`, `CountsAnswers`) it gets when it is opened.
    """

    def __init__(self, name: str, axes: tuple[str, ...], port: IsolatedPort) -> None:
        self.name = name
        self.axes = axes
        self._port = port
        self.tips: list[TipMeasured] = []

    def open(self) -> None:
        """The port opens it."""

    def enable(self, axes: Sequence[str]) -> None:
        """The port sends it with a job."""

    def exchange(self, commands: Mapping[str, float]) -> Mapping[str, Sample]:
        """The port sends it as a job."""
        return {}

    def disable(self, axes: Sequence[str], rest: Rest) -> None:
        """Send it without waiting for the answer, as when the control process ends by an error."""
        effect = next(each for each in Effect if each.value is rest)
        self._port.start(BusJob({}, ((0, effect, tuple(axes)),)))

    def clear_fault(self, axes: Sequence[str]) -> None:
        """The port sends it with a job."""

    def close(self) -> None:
        """The port closes it."""

    def add_abilities(self, found: Mapping[str, Any]) -> None:
        """The optional interfaces that the bus has."""
        if found.get("counts"):
            self.answer_counts = self._port.counts
        if found.get("tips"):
            self.measured_tips = self._take_tips
        if found.get("effort") is not None:
            effort: dict[str, float] = found["effort"]
            self.effort_limits = lambda: effort
            self.limit_effort = self._port.limit_effort

    def _take_tips(self) -> Sequence[TipMeasured]:
        tips, self.tips = self.tips, []
        return tips


class IsolatedPort(BusPort):
    """See `BusPort`; a late answer is a stall, the end of the bus process a loss of the bus."""

    def __init__(self, wiring: BusWiring) -> None:
        """Start the keeper of a bus; its driver is imported when the bus is opened, and not here."""
        axes = tuple(axis for axis, _ in wiring.axes)
        super().__init__(IsolatedBus(wiring.name, axes, self), threaded=False)
        self.threaded = True  # for the tick: its answer may come later
        self._driver = wiring.driver
        self._wire = BusWire(axes)
        options = wiring.options
        assert isinstance(options, IsolatedBusOptions)
        self._keeper, self._orders = keeper.start(f"contid.bus.{wiring.name}", options.body)
        self._connection: socket.socket | None = None
        self._number = 0
        self._began_s = 0.0
        self._ended = ""

    # -- opening and closing -----------------------------------------------------------------------------

    def begin_opening(self) -> None:
        """Start the bus process and let it open the bus; `finish_opening` waits for it."""
        self._start_process()
        self._send(BusRequest.OPEN)

    def finish_opening(self) -> None:
        """Wait until the bus is open.

        Raises:
            ContidError: it did not open in time, or why not.
        """
        found = self._ask(OPEN_S - (time.monotonic() - self._began_s))
        where = f"bus {self.bus.name}: driver {self._driver!r}"
        if found is None:
            raise DriverDefectError(f"{where} {self._ended or f'did not open the bus within {OPEN_S:g} s'}")
        if "error" in found and "exit_code" in found:
            error = ContidError(found["error"])
            error.exit_code = int(found["exit_code"])
            raise error
        if "error" in found:
            raise DriverDefectError(f"{where}: {found['error']}")
        assert isinstance(self.bus, IsolatedBus)
        self.bus.add_abilities(found)

    def close(self, timeout_s: float) -> None:
        """Close the bus and end its process, at once when it does not answer in time."""
        if self._orders.fileno() < 0:
            return
        if self._connection is not None:
            if not self._ended:
                self._send(BusRequest.CLOSE)
                self._ask(timeout_s)
            self._connection.close()
        self._orders.close()
        end_s = time.monotonic() + CLOSE_S
        while os.waitpid(self._keeper, os.WNOHANG)[0] == 0:
            if time.monotonic() > end_s:
                os.kill(self._keeper, signal.SIGKILL)
                os.waitpid(self._keeper, 0)
                return
            time.sleep(0.002)

    # -- jobs --------------------------------------------------------------------------------------------

    def lose(self, message: str) -> None:
        """Mark the bus as lost; its process, or the next one, opens it again."""
        self.lost = message
        self.retry_at = 0

    def start(self, job: BusJob) -> None:
        """Begin a job; `take` returns its result."""
        self.busy = True
        self.exempt = job.reopen or bool(job.effects)
        if self._ended and job.reopen:
            self._start_process()
        self._number = (self._number + 1) & 0xFFFFFFFF
        self._began_s = time.monotonic()
        self._write(self._wire.job(self._number, job))

    def take(self, timeout_s: float) -> BusReply | None:
        """The result of the job that was begun, or None when it is not done within the time."""
        if not self.busy:
            return None
        end_s = time.monotonic() + timeout_s
        if message := self._receive(BusRequest.JOB, end_s):
            reply, extra = self._wire.reply_of(message)
            for robot, tip, time_s in extra.get("tips", ()):
                assert isinstance(self.bus, IsolatedBus)
                self.bus.tips.append(TipMeasured(robot, tuple(tip), time_s))
            return self._done(reply)
        longest_s = OPEN_S if self.exempt else HANGS_S
        if not self._ended and time.monotonic() - self._began_s > longest_s:
            self._order(keeper.END)
            self._ended = f"did not answer for {longest_s:g} s; its process was ended"
        if self._ended:
            text = f"{self.bus.name}: driver {self._driver!r} {self._ended}"
            return self._done(BusReply(lost=text, fault=Fault.DRIVER_ENDED))
        self.stalls += 1
        return None

    def _done(self, reply: BusReply) -> BusReply:
        self.busy = False
        self.stalls = 0
        return reply

    # -- requests besides jobs ---------------------------------------------------------------------------

    def counts(self) -> Mapping[str, int]:
        """What the bus counted; empty when it does not answer."""
        if self.busy or self._ended:
            return {}
        self._send(BusRequest.COUNTS)
        return self._ask(COUNTS_S) or {}

    def limit_effort(self, shares: Mapping[str, float]) -> None:
        """Send limits of effort; they hold from the next exchange on."""
        self._write(HEAD.pack(BusRequest.EFFORT, 0, True) + json.dumps(dict(shares)).encode())

    # -- the sockets -------------------------------------------------------------------------------------

    def _start_process(self) -> None:
        """Let the keeper fork a bus process, and end one that is there."""
        if self._connection is not None:
            self._connection.close()
        self._connection, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._connection.setblocking(False)
        while self._news(0.0):  # of the one before
            pass
        self._ended = ""
        with theirs, suppress(OSError):
            socket.send_fds(self._orders, [keeper.OPEN], [theirs.fileno()])

    def _order(self, order: bytes) -> None:
        with suppress(OSError):
            self._orders.send(order, socket.MSG_DONTWAIT)

    def _send(self, kind: BusRequest) -> None:
        self._number = (self._number + 1) & 0xFFFFFFFF
        self._began_s = time.monotonic()
        self._write(HEAD.pack(kind, self._number, False))

    def _write(self, message: bytes) -> None:
        # A bus process that ended is reported by its keeper.
        with suppress(OSError):
            if self._connection is not None:
                self._connection.send(message)

    def _ask(self, timeout_s: float) -> dict[str, Any] | None:
        """The answer to the newest request that is no job, None without one."""
        message = self._receive(None, time.monotonic() + timeout_s)
        return json.loads(message) if message else None

    def _receive(self, kind: BusRequest | None, end_s: float) -> bytes:
        """The answer to the newest request; empty when none came in time or the bus process ended."""
        watched = [self._orders]
        if self._connection is not None and not self._ended:
            watched.append(self._connection)
        while True:
            ready = select.select(watched, (), (), max(end_s - time.monotonic(), 0.0))[0]
            if not ready:
                return b""
            if self._connection in ready:
                assert self._connection is not None
                message = b""
                with suppress(OSError):
                    message = self._connection.recv(LONGEST)
                if not message:
                    watched.remove(self._connection)
                else:
                    found, number, _ = HEAD.unpack_from(message)
                    if number == self._number and found == BusRequest.OPEN and kind is BusRequest.JOB:
                        self._ended = json.loads(message[HEAD.size :])["error"]  # it could not be built
                    elif number == self._number:
                        return message[HEAD.size :]
            if self._orders in ready and not self._news(0.0):
                watched.remove(self._orders)
            if self._ended:
                return b""

    def _news(self, timeout_s: float) -> bool:
        """Read a message of the keeper, if there is one; False when there is none."""
        if not select.select([self._orders], (), (), timeout_s)[0]:
            return False
        message = b""
        with suppress(OSError):
            message = self._orders.recv(LONGEST)
        if not message:
            self._ended = self._ended or "has lost its keeper"
            return False
        news = json.loads(message)
        if "ended" in news:
            self._ended = self._ended or news["ended"]
        else:
            level, logger, text = news["log"]
            logging.getLogger(logger).log(level, "%s: %s", self.bus.name, text)
        return True


def isolated_ports(buses: Mapping[str, BusWiring]) -> dict[str, IsolatedPort]:
    """A port of every bus that has a process of its own; forks, so before threads and real-time priority."""
    return {
        name: IsolatedPort(wiring)
        for name, wiring in buses.items()
        if isinstance(wiring.options, IsolatedBusOptions)
    }
