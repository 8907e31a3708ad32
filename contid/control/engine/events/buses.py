"""What happens on a bus: answers, stalls, device faults, old data, and what its wire counted."""

from __future__ import annotations

from typing import Annotated, Any

from contid.control.engine.events.base import BusName, RunEvent, Text, TickNumber, run_event


@run_event("answer")
class BusAnswered(RunEvent):
    """A bus was lost, or carried out or refused an effect; its samples are in the record."""

    tick: TickNumber
    bus: BusName
    lost: Annotated[str, "why the bus is lost"]
    done: Annotated[list[Any], "[robot index, effect] carried out"]
    refused: Annotated[list[Any], "[robot index, effect, message] refused by a device"]


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
