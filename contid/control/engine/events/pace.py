"""Ticks that did not run, and the statistics of those that did."""

from __future__ import annotations

from typing import Annotated

from contid.control.engine.events.base import RunEvent, run_event


@run_event("skipped")
class TicksSkipped(RunEvent):
    """Ticks were skipped because an earlier one took too long."""

    ticks: Annotated[int, "number of ticks"]
    total: Annotated[int, "ticks skipped so far"]
    longest_gap_ms: Annotated[float, "longest time between two ticks so far that others were left out of"] = (
        0.0
    )


@run_event("waited")
class TicksWaited(RunEvent):
    """Periods without ticks passed while devices were connected, armed or cleared."""

    ticks: Annotated[int, "number of periods"]
    total: Annotated[int, "periods waited for so far"]
    longest_gap_ms: Annotated[float, "longest time between two ticks so far that others were left out of"]


@run_event("stalled")
class ControlStalled(RunEvent):
    """The control process stands still, or ticks again; an event of the daemon, in no recording."""

    silent_s: Annotated[float, "time without a tick so far, in which it could have ticked"]
    over: Annotated[bool, "it ticks again"]


@run_event("report")
class PaceReported(RunEvent):
    """Statistics of the ticks at the end of the run."""

    ticks: Annotated[int, "number of ticks"]
    late: Annotated[int, "ticks that started late"]
    skipped: Annotated[int, "ticks that never started"]
    waited: Annotated[int, "periods that passed while devices were connected, armed or cleared"]
    lateness: Annotated[dict[str, float], "percentiles [us]"]
    longest_gap_ms: Annotated[float, "longest time between two ticks that others were left out of"] = 0.0
