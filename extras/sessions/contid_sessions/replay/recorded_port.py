"""A recording in the place of buses: the answer of a bus to a replayed tick is the recorded one."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from contid.control.engine.ports import BusJob, BusReply
from contid.control.engine.tick_layout import AXIS, TICK, AxisRecord
from contid.hal import Sample
from contid.session.read import Session


@dataclass(frozen=True, slots=True)
class RecordedBus:
    """A recorded bus."""

    name: str
    axes: tuple[str, ...]


class RecordedPort:
    """Replaces `contid.control.engine.ports.BusPort`: returns the answer recorded in the same tick."""

    threaded = False

    def __init__(self, name: str, slots: Mapping[str, int], recorded: RecordedTick) -> None:
        self.bus = RecordedBus(name, tuple(slots))
        self.lost = ""
        self.stalls = 0
        self.retry_at = 0
        self.exempt = False
        self.busy = False
        self._slots = dict(slots)
        self._recorded = recorded

    def lose(self, message: str) -> None:
        """Mark the bus as lost; reopening it must not delay the tick (`BusPort.lose`)."""
        self.lost, self.retry_at = message, 0

    def start(self, job: BusJob) -> None:
        """Begin a job; `take` returns its result.

        See `BusPort.start`; the commands are compared in the record.
        """
        self.busy, self.exempt = True, job.reopen or bool(job.effects)

    def take(self, timeout_s: float) -> BusReply | None:
        """The recorded answer; None in a tick without one."""
        recorded, name = self._recorded, self.bus.name
        answer = recorded.answers.pop(name, None)
        if answer is None:
            if self.lost or name in recorded.stalls:
                self.stalls += 1
                return None
            answer = BusReply()
        self.busy, self.stalls = False, 0
        if not answer.lost:
            answer.samples = self._samples()
        return answer

    def close(self, timeout_s: float) -> None:
        """Close the bus; a worker that hangs in its device is abandoned (a daemon thread)."""

    def _samples(self) -> dict[str, Sample]:
        values, faults = self._recorded.values, self._recorded.faults
        out = {}
        for axis, at in self._slots.items():
            read = AxisRecord(*values[at : at + AXIS.size])
            out[axis] = Sample(
                _number(read.value), read.time_s, bool(read.valid), read.age_s, _number(read.velocity),
                _number(read.effort), _number(read.temperature_c), _number(read.voltage_v),
                faults.get(axis, ""), _number(read.tension_n),
            )  # fmt: skip
        return out


def _number(value: float) -> float | None:
    return None if value != value else value


@dataclass(slots=True)
class RecordedTick:
    """Recorded values and events of the present tick."""

    values: Sequence[float] = ()
    answers: dict[str, BusReply] = field(default_factory=dict)
    stalls: set[str] = field(default_factory=set)
    faults: dict[str, str] = field(default_factory=dict)


def records_between(before: Sequence[float], after: Sequence[float], count: int) -> Iterator[list[float]]:
    """Records for ``count`` ticks that are missing behind ``before``.

    What is a number on both sides changes evenly, the rest is that of ``before``: an input that goes from one
    recorded sample to the next is the likeliest one, and an open loop does not depend on it.
    """
    for number in range(1, count + 1):
        share = number / (count + 1)
        values = [
            old + share * (new - old) if math.isfinite(new - old) else old
            for old, new in zip(before, after, strict=True)
        ]
        values[TICK] = before[TICK] + number
        yield values


def slots_of(session: Session, axes: Sequence[str]) -> dict[str, int]:
    """Index of the first value of every axis of a bus in a record."""
    slots = {
        f"{robot.name}.{axis}": session.layout.axis_start(index, number)
        for index, robot in enumerate(session.layout.robots)
        for number, axis in enumerate(robot.axes)
    }
    return {axis: slots[axis] for axis in axes if axis in slots}
