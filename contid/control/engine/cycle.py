"""What the engine shares with whoever turns it: a cycle's place in time, where it writes, how a run ends."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Protocol

from contid.control.engine.events import RunEvent


class OnEnd(enum.StrEnum):
    """What happens when the trajectory or the stream ends."""

    STOP = "stop"  # the robot file's stop.on_end, then the run ends
    REST = "rest"  # move to the rest pose, hold there, then the run ends
    HOLD = "hold"  # keep holding until somebody says otherwise


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
    """How one cycle stands in time.

    Attributes:
        tick: its number.
        skipped: ticks skipped since the start.
        deadline_s: when it should have started, on the clock of the buses.
        lateness_s: how much later it did.
        end_s: until when the buses may take, on the clock of the buses.
    """

    tick: int
    skipped: int
    deadline_s: float
    lateness_s: float = 0.0
    end_s: float = 0.0
