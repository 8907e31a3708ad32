"""Names of everything that is drawn: the picture writes these entities, the layout shows them."""

from __future__ import annotations

from typing import Final

EVENTS: Final = "events"
FLOOR: Final = "floor"
TIMING: Final = "plots/timing"
TIMES: Final = ("worst lateness", "longest work")

#: Timeline in seconds of the run, and the number of the tick.
TIME: Final = "time"
TICK: Final = "tick"


def body(robot: str, part: str) -> str:
    """In space: backbone, measured, tracked, tracked_tip, frames, base, target, trail, reach, rope."""
    return f"robots/{robot}/{part}"


def plot(robot: str, what: str) -> str:
    """A curve or bars: command, measured, tip_error, tip_error_measured, range."""
    return f"plots/{robot}/{what}"
