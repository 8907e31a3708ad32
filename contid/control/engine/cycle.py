"""Types shared by the engine and its callers: the timing of a cycle, the sink, the end of a run."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Protocol

from contid.control.engine.events.base import RunEvent


class OnEnd(enum.StrEnum):
    """What happens when the trajectory or the stream ends."""

    STOP = "stop"  # the robot file's stop.on_end, then the run ends
    REST = "rest"  # move to the rest pose, hold there, then the run ends
    HOLD = "hold"  # hold until an order


class Sink(Protocol):
    """Where records and events go: a ring, a log, or both."""

    def write(self, values: list[float]) -> None:
        """One tick, all values of the layout in order."""
        ...

    def event(self, event: RunEvent) -> None:
        """One event."""
        ...


@dataclass(frozen=True, slots=True)
class Timing:
    """The timing of one cycle.

    Attributes:
        tick: its number.
        skipped: ticks skipped since the start.
        deadline_s: when it should have started, on the clock of the buses.
        lateness_s: how much later it started.
        end_s: deadline of the exchanges, on the clock of the buses.
    """

    tick: int
    skipped: int
    deadline_s: float
    lateness_s: float = 0.0
    end_s: float = 0.0
