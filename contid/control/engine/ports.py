"""Exchange with every bus: in the thread of the tick for a single bus, in a worker thread each for several.

With workers a slow device stalls its own bus only (husarion/rosbot_ros PR 196). A worker that is not done
by the end of the tick gets no new job until it is; its robots count a miss.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from queue import Empty, SimpleQueue

from contid.control.engine.checked_samples import checked_samples
from contid.control.engine.messages import Measured
from contid.control.tick.faults import Fault
from contid.control.tick.state import Effect
from contid.errors import ContidError
from contid.hal import Bus, MeasuresTips, Rest, Sample
from contid.records import record

log = logging.getLogger(__name__)


@record(frozen=True, slots=True)
class BusJob:
    """The work of a bus in one tick.

    Attributes:
        commands: device values by axis.
        effects: robot index, effect and axes; carried out before the exchange.
        reopen: open the bus first.
    """

    commands: Mapping[str, float]
    effects: tuple[tuple[int, Effect, tuple[str, ...]], ...] = ()
    reopen: bool = False


@dataclass(slots=True)
class BusReply:
    """The result of a job.

    Attributes:
        samples: by axis, None when the exchange failed.
        lost: why the bus is lost, "" otherwise.
        done: effects that succeeded, by robot index.
        refused: effects that a device refused, with its message.
        fault: of the robots on a bus that is lost.
    """

    samples: Mapping[str, Sample] | None = None
    lost: str = ""
    done: list[tuple[int, Effect]] = field(default_factory=list)
    refused: list[tuple[int, Effect, str]] = field(default_factory=list)
    fault: Fault = Fault.DEVICE_LOST


def perform(bus: Bus, job: BusJob) -> BusReply:
    """Do a job; never raises, because one bus must not end the tick of the others."""
    answer = BusReply()
    try:
        if job.reopen:
            bus.open()
        for robot, effect, axes in job.effects:
            try:
                _apply(bus, effect, axes)
            except ContidError as error:
                answer.refused.append((robot, effect, str(error)))
            except (Exception, SystemExit) as error:  # the devices of the others have to rest all the same
                answer.lost = answer.lost or _defect(bus, error)
            else:
                answer.done.append((robot, effect))
        if not answer.lost:
            answer.samples = checked_samples(bus, bus.exchange(job.commands))
    except ContidError as error:
        answer.lost = str(error)
    except (Exception, SystemExit) as error:  # a driver's defect ends its bus, not the process of all
        answer.lost = _defect(bus, error)
    return answer


def _defect(bus: Bus, error: BaseException) -> str:
    return f"{bus.name}: {type(error).__name__}: {error}"


def _apply(bus: Bus, effect: Effect, axes: tuple[str, ...]) -> None:
    if effect is Effect.ENABLE:
        bus.enable(axes)
    elif effect is Effect.CLEAR:
        bus.clear_fault(axes)
    elif isinstance(effect.value, Rest):
        bus.disable(axes, effect.value)


class BusPort:
    """A bus and its worker, if it has one.

    Attributes:
        bus: the bus; only this port uses it while it is open.
        lost: why the bus is lost, "" while it is not.
        exempt: the job under way may take longer than a tick, because it arms, clears or opens something.
        busy: the last job is not done.
        threaded: a worker thread does the jobs.
        stalls: ticks in a row that ended before the job was done.
        retry_at: number of the tick of the next attempt to open a lost bus.
    """

    def __init__(
        self,
        bus: Bus,
        threaded: bool,
        reopen_aside: bool = False,
        prepare: Callable[[bool], None] = lambda begins: None,
    ) -> None:
        """Take a bus.

        Args:
            bus: already open.
            threaded: a worker does the jobs from the start.
            reopen_aside: a worker takes over when the bus is lost, because opening it again may take long.
            prepare: called before and after a request in the thread of the tick, which may take long.
        """
        self.bus = bus
        self._reopen_aside = reopen_aside
        self._prepare = prepare
        self.lost = ""
        self.stalls = 0
        self.exempt = False
        self.retry_at = 0
        self._answer: BusReply | None = None
        self.busy = False
        self.threaded = False
        self._jobs: SimpleQueue[BusJob | None] = SimpleQueue()
        self._answers: SimpleQueue[BusReply] = SimpleQueue()
        self._worker: threading.Thread | None = None
        self._job_began_s = self._job_took_s = 0.0
        if threaded:
            self.hand_over()

    def lose(self, message: str) -> None:
        """Mark the bus as lost; reopening it must not delay the tick."""
        self.lost = message
        self.retry_at = 0
        if self._reopen_aside:
            self.hand_over()

    def hand_over(self) -> None:
        """From now on a worker does the jobs."""
        if self._worker is None:
            self.threaded = True
            self._worker = threading.Thread(target=self._work, name=f"bus {self.bus.name}", daemon=True)
            self._worker.start()

    def start(self, job: BusJob) -> None:
        """Begin a job; `take` returns its result."""
        self.busy = True
        self.exempt = job.reopen or bool(job.effects)
        if self._worker is None:
            if self.exempt:
                self._prepare(True)
            self._answer = perform(self.bus, job)
            if self.exempt:
                self._prepare(False)
        else:
            self._jobs.put(job)

    def take(self, timeout_s: float) -> BusReply | None:
        """The result of the job that was begun, or None when it is not done within the time."""
        if not self.busy:
            return None
        if self._worker is None:
            answer, self._answer = self._answer, None
        else:
            try:
                answer = self._answers.get(timeout=max(timeout_s, 0.0))
            except Empty:
                self.stalls += 1
                return None
        self.busy = False
        self.stalls = 0
        return answer

    def rest(self, axes: Sequence[str], rest: Rest) -> None:
        """Bring axes to rest after an internal error, unless the worker is using the bus."""
        if self._worker is None or not self.busy:
            self.bus.disable(axes, rest)

    def close(self, timeout_s: float) -> None:
        """Close the bus; a worker that hangs in its device is abandoned (a daemon thread)."""
        if self._worker is not None:
            self._jobs.put(None)
            self._worker.join(timeout_s)
            if self._worker.is_alive():
                return
            self._worker, self.threaded = None, False
        self.bus.close()

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            self._job_began_s = time.monotonic()
            reply = perform(self.bus, job)
            self._job_took_s = time.monotonic() - self._job_began_s
            self._answers.put(reply)

    def job_s(self, now_s: float) -> float:
        """How long the worker has been at its job, or was at its last one; 0 without a worker."""
        if self._worker is None:
            return 0.0
        return now_s - self._job_began_s if self.busy else self._job_took_s


class BusTrackers:
    """Buses that track tips, such as that of a simulated arm: their tips as the messages of any tracker.

    A replay has the messages in the recording instead.
    """

    def __init__(self, buses: Iterable[Bus]) -> None:
        self._buses = [bus for bus in buses if isinstance(bus, MeasuresTips)]

    def arrived(self, deadline_s: float) -> Iterator[Measured]:
        """What arrived since the last call; ages are those at the deadline of a tick."""
        for bus in tuple(self._buses):
            try:
                for tip in bus.measured_tips():
                    yield Measured(tip.robot, tip.tip_in_world_m, age_s=max(0.0, deadline_s - tip.time_s))
            except Exception as error:  # a driver's defect ends its tracker, not the process
                self._buses.remove(bus)
                log.warning("a tracker is not read any more: %s: %s", type(error).__name__, error)
