"""Names of Rerun's entities: `rerun_writer` writes them, `layout` shows them."""

from __future__ import annotations

from typing import Final

EVENTS: Final = "events"
BANNER: Final = "banner"
FLOOR: Final = "floor"
TIMING: Final = "plots/timing"
TIMES: Final = ("worst lateness", "longest work")

#: Timelines: seconds of the run, number of the tick.
TIME: Final = "time"
TICK: Final = "tick"


#: Parts of every robot in space; some also have reach, rope, compliance and load.
PARTS: Final = (
    "base", "body", "backbone", "measured", "tracked", "tracked_tip", "frames", "target", "trail",
)  # fmt: skip


def body(robot: str, part: str) -> str:
    """A part of a robot in space: one of `PARTS`, or a further one."""
    return f"robots/{robot}/{part}"


def obstacle(name: str) -> str:
    """An obstacle of the robot file in space."""
    return f"obstacles/{name}"


def plot(robot: str, what: str) -> str:
    """Curves or bars: command, measured, tip_error, tip_error_measured, range, range_names, range_tracks."""
    return f"plots/{robot}/{what}"
