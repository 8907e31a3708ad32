"""The port of a bus in a process of its own: what the tick has instead of a bus and a worker thread.

The control process sends a job in one tick and takes its answer in the same or a later one; it never waits
longer than the tick allows. An answer that is late is a stall, which counts as a miss of the robots.
"""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from typing import Any, Final

from contid.control.engine.ports import BusJob, BusPort, BusReply
from contid.control.process.isolation.link import KeptProcess
from contid.control.process.isolation.wire import HEAD, BusRequest, BusWire
from contid.control.tick.faults import Fault
from contid.control.tick.state import Effect
from contid.errors import ContidError, DriverDefectError
from contid.hal import Rest, Sample, TipMeasured
from contid.hal.isolated import IsolatedBusOptions
from contid.robot_file.document import BusWiring

#: Longest job that opens a bus, or that arms, clears or disables axes.
OPEN_S: Final = 10.0
#: Longest other job; then the bus process is ended and, at the next attempt to reopen, started again.
HANGS_S: Final = 0.5
#: Longest wait for the counts of a bus at the end of a run.
COUNTS_S: Final = 0.5


class IsolatedBus:
    """What the control process has of the bus: its name and its axes; it may send, and never waits.

    Attributes:
        name: name of the bus.
        axes: names of its axes.
        tips: tips that the bus has measured and nothing has taken yet.
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
        robot = 0  # no robot takes the answer
        self._port.start(BusJob({}, ((robot, effect, tuple(axes)),)))
        self._port.busy = False  # for another robot on this bus

    def clear_fault(self, axes: Sequence[str]) -> None:
        """The port sends it with a job."""

    def close(self) -> None:
        """The port closes it."""

    def add_abilities(self, found: Mapping[str, Any]) -> None:
        """Get the methods of the optional interfaces that the bus was found to have when it was opened.

        These are `CountsAnswers`, `MeasuresTips` and `LimitsEffort`: protocols, which are recognised by their
        methods, so the methods are attributes of this object alone.

        Args:
            found: the answer of the bus process to the request to open.
        """
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
    """See `BusPort`; the end of the bus process is a loss of the bus."""

    def __init__(self, wiring: BusWiring) -> None:
        """Start the process that keeps that of a bus; the driver is imported when the bus is opened."""
        axes = tuple(axis for axis, _ in wiring.axes)
        super().__init__(IsolatedBus(wiring.name, axes, self), threaded=False)
        self.threaded = True  # for the tick: its answer may come later
        self._driver = wiring.driver
        self._tolerance = wiring.tolerance_ticks
        self._wire = BusWire(axes)
        options = wiring.options
        assert isinstance(options, IsolatedBusOptions)
        self._link = KeptProcess(wiring.name, options.body)
        self._shares: dict[str, float] = {}  # limits of effort

    # -- opening and closing -----------------------------------------------------------------------------

    def begin_opening(self) -> None:
        """Start the bus process and let it open the bus; `finish_opening` waits for it."""
        self._link.start_process()
        self._link.send(BusRequest.OPEN)

    def finish_opening(self) -> None:
        """Wait until the bus is open.

        Raises:
            DriverDefectError: it did not open in time, its process ended, or the driver raised another error.
            ContidError: the driver raised it.
        """
        found = self._link.ask(OPEN_S - (time.monotonic() - self._link.began_s))
        where = f"bus {self.bus.name}: driver {self._driver!r}"
        if found is None:
            raise DriverDefectError(
                f"{where} {self._link.ended or f'did not open the bus within {OPEN_S:g} s'}"
            )
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
        self._link.close(timeout_s)

    # -- jobs --------------------------------------------------------------------------------------------

    def lose(self, message: str) -> None:
        """Mark the bus as lost; its process, or the next one, opens it again."""
        self.lost = message
        self.retry_at = 0

    def start(self, job: BusJob) -> None:
        """Begin a job; `take` returns its result."""
        self.busy = True
        self.exempt = job.reopen or bool(job.effects)
        anew = self._link.ended and job.reopen
        if anew:
            self._link.start_process()
        self._link.write(self._wire.job(self._link.next_number(), job))
        if anew and self._shares:
            self._send_shares()

    def take(self, timeout_s: float) -> BusReply | None:
        """The result of the job that was begun, or None when it is not done within the time."""
        if not self.busy:
            return None
        end_s = time.monotonic() + timeout_s
        if message := self._link.receive(BusRequest.JOB, end_s):
            reply, extra = self._wire.reply_of(message)
            assert isinstance(self.bus, IsolatedBus)
            for robot, tip, time_s in extra.get("tips", ()):
                self.bus.tips.append(TipMeasured(robot, tuple(tip), time_s))
            return self._done(reply)
        longest_s = OPEN_S if self.exempt else HANGS_S
        if not self._link.ended and time.monotonic() - self._link.began_s > longest_s:
            self._link.end_process(f"did not answer for {longest_s:g} s; its process was ended")
        if self._link.ended:
            return self._done(self._reply_of_end(self._link.ended))
        self.stalls += 1
        if not self.lost and self.stalls >= self._tolerance and self._link.is_ending():
            # It stays busy until its keeper has reported the end, so that no other job is begun before.
            return self._reply_of_end("has ended")
        return None

    def _reply_of_end(self, how: str) -> BusReply:
        """The result of a job whose bus process ended."""
        return BusReply(lost=f"{self.bus.name}: driver {self._driver!r} {how}", fault=Fault.DRIVER_ENDED)

    def _done(self, reply: BusReply) -> BusReply:
        """Note that the job is done, and return its result."""
        self.busy = False
        self.stalls = 0
        return reply

    # -- requests besides jobs ---------------------------------------------------------------------------

    def counts(self) -> Mapping[str, int]:
        """What the bus counted; empty when it does not answer."""
        if self.busy or self._link.ended:
            return {}
        self._link.send(BusRequest.COUNTS)
        return self._link.ask(COUNTS_S) or {}

    def limit_effort(self, shares: Mapping[str, float]) -> None:
        """Send limits of effort, shares of the greatest by axis; they hold from the next exchange on.

        A bus process that is started anew gets them too.
        """
        self._shares |= shares
        self._send_shares()

    def _send_shares(self) -> None:
        number, has_json = 0, True  # it has no answer
        head = HEAD.pack(BusRequest.EFFORT, number, has_json)
        self._link.write(head + json.dumps(self._shares).encode())


def isolated_ports(buses: Mapping[str, BusWiring]) -> dict[str, IsolatedPort]:
    """A port of every bus that has a process of its own; forks, so before threads and real-time priority."""
    return {
        name: IsolatedPort(wiring)
        for name, wiring in buses.items()
        if isinstance(wiring.options, IsolatedBusOptions)
    }
