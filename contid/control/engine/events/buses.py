"""What happens on a bus: answers, stalls, device faults, old data, and what its wire counted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from contid.control.engine.events.base import BusName, RunEvent, Text, TickNumber


@dataclass(frozen=True, slots=True, kw_only=True)
class BusAnswered(RunEvent):
    """A bus was lost, or carried out or refused an effect; its samples are in the record."""

    KIND: ClassVar[str] = "answer"
    tick: TickNumber
    bus: BusName
    lost: Annotated[str, "why the bus is lost"]
    done: Annotated[list[Any], "[robot index, effect] carried out"]
    refused: Annotated[list[Any], "[robot index, effect, message] refused by a device"]


@dataclass(frozen=True, slots=True, kw_only=True)
class BusStalled(RunEvent):
    """A bus did not answer within the tick."""

    KIND: ClassVar[str] = "stall"
    tick: TickNumber
    bus: BusName


@dataclass(frozen=True, slots=True, kw_only=True)
class BusChanged(RunEvent):
    """A bus answers again, or an effect cannot reach a lost one."""

    KIND: ClassVar[str] = "bus"
    bus: BusName
    message: Text


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceFaultChanged(RunEvent):
    """The fault that a device reports changed."""

    KIND: ClassVar[str] = "device"
    tick: TickNumber
    axis: Annotated[str, "ROBOT.AXIS"]
    fault: Annotated[str, "fault the device reports, empty for none"]


@dataclass(frozen=True, slots=True, kw_only=True)
class StalenessChanged(RunEvent):
    """The age class of the data of a bus changed."""

    KIND: ClassVar[str] = "tier"
    tick: TickNumber
    bus: BusName
    tier: Annotated[str, "age class of the data now"]
    before: Annotated[str, "age class of the data before"]
    age_s: Annotated[float, "age of the oldest sample, or of a measurement"]


@dataclass(frozen=True, slots=True, kw_only=True)
class BusReported(RunEvent):
    """What a bus counted on its wire (`contid.hal.CountsAnswers`), at the end of the run."""

    KIND: ClassVar[str] = "wire"
    bus: BusName
    counts: Annotated[dict[str, int], "numbers of exchanges, and of answers that were late, silent or broken"]
