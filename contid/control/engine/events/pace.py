"""Ticks that did not run, and the statistics of those that did."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from contid.control.engine.events.base import RunEvent


@dataclass(frozen=True, slots=True, kw_only=True)
class TicksSkipped(RunEvent):
    """Ticks were skipped because an earlier one took too long."""

    KIND: ClassVar[str] = "skipped"
    ticks: Annotated[int, "number of ticks"]
    total: Annotated[int, "ticks skipped so far"]
    longest_gap_ms: Annotated[float, "longest time between two ticks so far that others were left out of"] = (
        0.0
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class TicksWaited(RunEvent):
    """Periods without ticks passed while devices were connected, armed or cleared."""

    KIND: ClassVar[str] = "waited"
    ticks: Annotated[int, "number of periods"]
    total: Annotated[int, "periods waited for so far"]
    longest_gap_ms: Annotated[float, "longest time between two ticks so far that others were left out of"]


@dataclass(frozen=True, slots=True, kw_only=True)
class PaceReported(RunEvent):
    """Statistics of the ticks at the end of the run."""

    KIND: ClassVar[str] = "report"
    ticks: Annotated[int, "number of ticks"]
    late: Annotated[int, "ticks that started late"]
    skipped: Annotated[int, "ticks that never started"]
    waited: Annotated[int, "periods that passed while devices were connected, armed or cleared"]
    lateness: Annotated[dict[str, float], "percentiles [us]"]
    longest_gap_ms: Annotated[float, "longest time between two ticks that others were left out of"] = 0.0
