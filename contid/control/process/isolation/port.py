"""The port of a bus in a process of its own: what the tick has instead of a bus and a worker thread.

The tick sends a job with `IsolatedPort.start` and asks for its result with `take`, in the same tick or in a
later one; it never waits longer than the tick allows. While a job is under way (``busy``), `take` finds:

    the bus process has answered                       its result                   no longer busy
    it has ended, or took too long and is ended now    the bus is lost              no longer busy
    it is ending, and why is not known yet, after as   the bus is lost              busy until that is known:
    many ticks as its robots tolerate                                               no process starts before
    none of these                                      None, a miss of its robots   busy
"""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from typing import Any, Final

from contid.control.engine.ports import BusJob, BusPort, BusReply
from contid.control.process.isolation.bus_process import BusProcess
from contid.control.process.isolation.link import KeptProcess, ProcessState
from contid.control.process.isolation.wire import BusWire, RequestKind
from contid.control.tick.faults import Fault
from contid.control.tick.state import Effect
from contid.errors import ContidError, DriverDefectError
from contid.hal import Rest, TipMeasured
from contid.hal.isolated import IsolatedBusOptions
from contid.robot_file.document import BusWiring

#: Longest job that opens a bus, or that arms, clears or disables axes.
OPEN_S: Final = 10.0
#: Longest other job; then the bus process is ended and, at the next attempt to reopen, started again.
HANGS_S: Final = 0.5
#: Longest wait for the counts of a bus at the end of a run.
COUNTS_S: Final = 0.5


class IsolatedBus:
    """What the control process has of the bus; everything else is done by its port.

    Attributes:
        name: name of the bus.
        axes: names of its axes.
        tips: tips that the bus has measured and nothing has taken yet.
    """

    def __init__(self, name: str, axes: tuple[str, ...]) -> None:
        self.name = name
        self.axes = axes
        self.tips: list[TipMeasured] = []

    def _never(self, *_: Any, **__: Any) -> Any:
        raise NotImplementedError(f"bus {self.name} is used through its port")

    open = enable = exchange = disable = clear_fault = close = _never

    def add_abilities(self, found: Mapping[str, Any], port: IsolatedPort) -> None:
        """Get the methods of the optional interfaces that the bus was found to have when it was opened.

        These are `CountsAnswers`, `MeasuresTips` and `LimitsEffort`: protocols, which are recognised by their
        methods, so the methods are attributes of this object alone.
        """
        if found["counts"]:
            self.answer_counts = port.counts
        if found["tips"]:
            self.measured_tips = self._take_tips
        if found["effort"] is not None:
            effort: dict[str, float] = found["effort"]
            self.effort_limits = lambda: effort
            self.limit_effort = port.limit_effort

    def _take_tips(self) -> Sequence[TipMeasured]:
        tips, self.tips = self.tips, []
        return tips


class IsolatedPort(BusPort):
    """See `BusPort`."""

    bus: IsolatedBus

    def __init__(self, wiring: BusWiring) -> None:
        """Fork the keeper of the bus process, which `begin_opening` starts."""
        axes = tuple(axis for axis, _ in wiring.axes)
        super().__init__(IsolatedBus(wiring.name, axes), threaded=False)
        self.threaded = True  # for the tick: its answer may come later
        self._driver = f"driver {wiring.driver!r}"
        self._tolerance = wiring.tolerance_ticks
        self._wire = BusWire(axes)
        options = wiring.options
        assert isinstance(options, IsolatedBusOptions)
        self._link = KeptProcess(wiring.name, BusProcess, options.body)
        self._shares: dict[str, float] = {}  # limits of effort

    # -- opening and closing -----------------------------------------------------------------------------

    def begin_opening(self) -> None:
        """Start the bus process and let it open the bus; `finish_opening` waits for it."""
        self._link.start_process()
        self._link.request(RequestKind.OPEN)

    def finish_opening(self) -> None:
        """Wait until the bus is open.

        Raises:
            DriverDefectError: it did not open in time, its process ended, or the driver raised another error.
            ContidError: the driver raised it.
        """
        found = self._link.answer_json(OPEN_S - (time.monotonic() - self._link.requested_s))
        where = f"bus {self.bus.name}: {self._driver}"
        if found is None:
            why = self._link.how_ended or f"did not open the bus within {OPEN_S:g} s"
            raise DriverDefectError(f"{where} {why}")
        if "exit_code" in found:
            error = ContidError(found["error"])
            error.exit_code = int(found["exit_code"])
            raise error
        if "error" in found:
            raise DriverDefectError(f"{where}: {found['error']}")
        self.bus.add_abilities(found, self)

    def close(self, timeout_s: float) -> None:
        """Close the bus and end its process, at once when it does not answer in time."""
        self._link.close(timeout_s)

    # -- jobs --------------------------------------------------------------------------------------------

    def start(self, job: BusJob) -> None:
        """Begin a job; `take` returns its result."""
        self.busy = True
        self.exempt = job.reopen or bool(job.effects)
        anew = self._link.state is ProcessState.ENDED and job.reopen
        if anew:
            self._link.start_process()
        self._link.request(RequestKind.JOB, self._wire.job(job))
        if anew and self._shares:
            self.limit_effort({})

    def take(self, timeout_s: float) -> BusReply | None:
        """The result of the job that was begun, or None when it is not done within the time."""
        if not self.busy:
            return None
        link = self._link
        answer = link.answer(timeout_s)
        if answer is not None and answer.kind is RequestKind.JOB:
            reply, extra = self._wire.reply_of(answer.body)
            self.bus.tips += [
                TipMeasured(robot, tuple(tip), at_s) for robot, tip, at_s in extra.get("tips", ())
            ]
            return self._done(reply)
        longest_s = OPEN_S if self.exempt else HANGS_S
        if answer is not None:  # the first job of a process that was started anew builds the bus: that failed
            link.end_process(json.loads(answer.body)["error"])
        elif link.state is not ProcessState.ENDED and time.monotonic() - link.requested_s > longest_s:
            link.end_process(f"did not answer for {longest_s:g} s; its process was ended")
        if link.state is ProcessState.ENDED:
            return self._done(self._loss(link.how_ended))
        self.stalls += 1
        if not self.lost and self.stalls >= self._tolerance and link.is_ending():
            return self._loss("has ended")
        return None

    def _loss(self, how: str) -> BusReply:
        """The result of a job whose bus process ended."""
        return BusReply(lost=f"{self.bus.name}: {self._driver} {how}", fault=Fault.DRIVER_ENDED)

    def _done(self, reply: BusReply) -> BusReply:
        """Note that the job is done, and return its result."""
        self.busy = False
        self.stalls = 0
        return reply

    # -- requests besides jobs ---------------------------------------------------------------------------

    def rest(self, axes: Sequence[str], rest: Rest) -> None:
        """See `BusPort.rest`: the bus process does it after the job that is under way."""
        effect = next(each for each in Effect if each.value is rest)
        robot = 0  # no robot takes the answer
        self._link.send_unanswered(
            RequestKind.JOB, self._wire.job(BusJob({}, ((robot, effect, tuple(axes)),)))
        )

    def counts(self) -> Mapping[str, int]:
        """What the bus counted; empty when it does not answer."""
        if self.busy or self._link.state is ProcessState.ENDED:
            return {}
        self._link.request(RequestKind.COUNTS)
        return self._link.answer_json(COUNTS_S) or {}

    def limit_effort(self, shares: Mapping[str, float]) -> None:
        """Send limits of effort, shares of the greatest by axis; they hold from the next exchange on.

        A bus process that is started anew gets those of before too.
        """
        self._shares |= shares
        self._link.send_unanswered(RequestKind.EFFORT, json.dumps(self._shares).encode())


def isolated_ports(buses: Mapping[str, BusWiring]) -> dict[str, IsolatedPort]:
    """A port of every bus that has a process of its own; forks, so before threads and real-time priority."""
    return {
        name: IsolatedPort(wiring)
        for name, wiring in buses.items()
        if isinstance(wiring.options, IsolatedBusOptions)
    }
