"""What is late or lost: answers of buses, old data, ticks, and what a reader of the ring did not get."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Final

from contid.control.engine.events import BusName, RunEvent, Text, TickNumber, run_event


@run_event("answer")
class BusAnswered(RunEvent):
    """A bus was lost, or carried out or refused an effect; its samples are in the record."""

    tick: TickNumber
    bus: BusName
    lost: Annotated[str, "why the bus is lost"]
    done: Annotated[list[Any], "[robot index, effect] carried out"]
    refused: Annotated[list[Any], "[robot index, effect, message] refused by a device"]
    fault: Annotated[int, "number of the fault of its robots when the bus is lost"] = 101


@run_event("stall")
class BusStalled(RunEvent):
    """A bus did not answer within the tick."""

    tick: TickNumber
    bus: BusName


@run_event("bus")
class BusChanged(RunEvent):
    """A bus answers again, or an effect cannot reach a lost one."""

    bus: BusName
    message: Text


@run_event("device")
class DeviceFaultChanged(RunEvent):
    """The fault that a device reports changed."""

    tick: TickNumber
    axis: Annotated[str, "ROBOT.AXIS"]
    fault: Annotated[str, "fault the device reports, empty for none"]


@run_event("tier")
class StalenessChanged(RunEvent):
    """The age class of the data of a bus changed."""

    tick: TickNumber
    bus: BusName
    tier: Annotated[str, "age class of the data now"]
    before: Annotated[str, "age class of the data before"]
    age_s: Annotated[float, "age of the oldest sample, or of a measurement"]


@run_event("wire")
class BusReported(RunEvent):
    """What a bus counted on its wire (`contid.hal.CountsAnswers`), at the end of the run."""

    bus: BusName
    counts: Annotated[dict[str, int], "numbers of exchanges, and of answers that were late, silent or broken"]


@run_event("skipped")
class TicksSkipped(RunEvent):
    """Ticks were skipped because an earlier one took too long."""

    ticks: Annotated[int, "number of ticks"]
    total: Annotated[int, "ticks skipped so far"]
    longest_gap_ms: Annotated[float, "longest time between two ticks so far that others were left out of"] = (
        0.0
    )
    cause: Annotated[str, "what took the time of the longest gap since the event before"] = ""

    def __str__(self) -> str:
        """For a person."""
        text = f"{self.ticks} {'tick' if self.ticks == 1 else 'ticks'} skipped ({self.total} in all)"
        return f"{text}: {self.cause}" if self.cause else text


#: Most frames of telemetry per second that a client gets while ticks do not fit.
TELEMETRY_HZ: Final = 5.0


@run_event("overload")
class OverloadChanged(RunEvent):
    """What gives way while ticks do not fit has changed (`contid.control.process.slowdown`)."""

    level: Annotated[int, "0: nothing; 1: telemetry; 2: ticks come half as often; 3: a quarter as often"]
    rate_hz: Annotated[float, "rate of the ticks from now on"]
    full_rate_hz: Annotated[float, "rate of the run"]
    work_ms: Annotated[float, "mean time of a tick"]

    def __str__(self) -> str:
        """For a person."""
        took = f"a tick takes {self.work_ms:.3g} of {1e3 / self.full_rate_hz:.3g} ms"
        if not self.level:
            return f"ticks fit again ({took}): telemetry and robots go on as asked"
        frames = f"clients get at most {TELEMETRY_HZ:g} frames per second"
        if self.level == 1:
            return f"overload, {took}: {frames}"
        share = self.full_rate_hz / self.rate_hz
        return (
            f"overload, {took}: ticks at {self.rate_hz:g} of {self.full_rate_hz:g} Hz, every robot moves at "
            f"1/{share:g} of its speed; {frames}; lower rate_hz, or divide the robots between files"
        )


@run_event("waited")
class TicksWaited(RunEvent):
    """Periods without ticks passed while devices were connected, armed or cleared."""

    ticks: Annotated[int, "number of periods"]
    total: Annotated[int, "periods waited for so far"]
    longest_gap_ms: Annotated[float, "longest time between two ticks so far that others were left out of"]


@run_event("stalled")
class ControlStalled(RunEvent):
    """The control process stands still, or ticks again; the daemon sends it, and no recording has it."""

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


@run_event("recorder")
class RecorderFailed(RunEvent):
    """The control process ended without closing the ring."""

    message: Text


@run_event("overrun")
class RecorderOverrun(RunEvent):
    """The ring was overwritten before the recorder had read it."""

    missed_ticks: Annotated[int, "ticks that are not in the file"]
    missed_events: Annotated[int, "events that are not in the file"]


@run_event("viewer")
class ViewerPaused(RunEvent):
    """The ring was overwritten before the viewer had read it; written by the viewer."""

    message: Text


@run_event("too_long")
class EventTooLong(RunEvent):
    """Replaces an event that does not fit into the ring."""

    kind: Annotated[str, "of the event"]


@dataclass(frozen=True, slots=True, kw_only=True)
class UnknownEvent(RunEvent):
    """An event of another version, or a damaged one."""

    kind: str
    values: Mapping[str, Any]
