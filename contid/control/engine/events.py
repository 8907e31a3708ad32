"""The events of a run as types; their JSON and its schema derive from the fields declared here.

The control process writes them into the ring, the recorder into the session file. Daemon, server and viewer
match on the types. An event of a kind or with values that this version does not know is an `UnknownEvent`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from typing import Annotated, Any, ClassVar, Final, TypeAlias, get_args, get_origin, get_type_hints

_Tick: TypeAlias = Annotated[int, "number of the tick it belongs to"]
_Robot: TypeAlias = Annotated[str, "name of the robot"]
_Bus: TypeAlias = Annotated[str, "name of the bus"]
_Message: TypeAlias = Annotated[str, "text for a person"]


@dataclass(frozen=True, slots=True, kw_only=True)
class RunEvent:
    """Base of all events; ``KIND`` is the value of ``event`` in their JSON."""

    KIND: ClassVar[str] = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunStarted(RunEvent):
    """The buses are open; the message is the reason when real-time priority was refused."""

    KIND: ClassVar[str] = "started"
    realtime: Annotated[bool, "the control process has real-time priority"]
    message: _Message


@dataclass(frozen=True, slots=True, kw_only=True)
class RunFailed(RunEvent):
    """The control process cannot continue."""

    KIND: ClassVar[str] = "failed"
    message: _Message
    exit_code: Annotated[int, "of the process"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ModeChanged(RunEvent):
    """A robot entered a mode."""

    KIND: ClassVar[str] = "state"
    robot: _Robot
    mode: Annotated[str, "new mode of the robot"]
    tick: _Tick


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultLatched(RunEvent):
    """A robot entered FAULT."""

    KIND: ClassVar[str] = "fault"
    robot: _Robot
    fault: Annotated[int, "number of the fault"]
    name: Annotated[str, "name of the fault"]
    message: _Message
    detail: Annotated[str, "what happened, without the remedy"] = ""
    tick: _Tick


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactBegan(RunEvent):
    """A force acts on a robot that neither its model nor its known load explains."""

    KIND: ClassVar[str] = "contact"
    tick: _Tick
    robot: _Robot
    axis: Annotated[str, "axes whose currents showed it, empty for the tip"] = ""
    time_s: Annotated[float, "capture of the measurement that showed it, in the time of the robots"]
    direction: Annotated[list[float], "of the force, unit vector in the world frame; empty where it has none"]
    force_n: Annotated[float, "size of the force on the tip when it was found [N]; 0 for an axis"]
    excess_ma: Annotated[float, "current above the usual one [mA]; 0 for the tip"] = 0.0
    confidence: Annotated[float, "1 minus the number of such events by noise alone expected in an hour"]
    policy: Annotated[str, "reaction: ignore, hold, stop or retract"]
    message: _Message


@dataclass(frozen=True, slots=True, kw_only=True)
class SqueezeChanged(RunEvent):
    """A tip that closes until a force reached it, lost the object, or ended without."""

    KIND: ClassVar[str] = "squeeze"
    tick: _Tick
    robot: _Robot
    what: Annotated[str, "reached, lost, nothing (no force up to the target), pressed (no free way), weak"]
    force_n: Annotated[float, "of the tip along its way, from the currents [N]"]
    message: _Message


@dataclass(frozen=True, slots=True, kw_only=True)
class OrderRefused(RunEvent):
    """An order, or a part of one, was not carried out."""

    KIND: ClassVar[str] = "refused"
    robot: _Robot = ""
    message: _Message


@dataclass(frozen=True, slots=True, kw_only=True)
class EffortLimited(RunEvent):
    """The effort of a robot was limited to a share of that of the robot file."""

    KIND: ClassVar[str] = "grip"
    tick: _Tick
    robot: _Robot
    share: Annotated[float, "share, 0 to 1"]


@dataclass(frozen=True, slots=True, kw_only=True)
class OrderGiven(RunEvent):
    """An order reached the engine before a tick; its JSON has the keys of ``order`` itself."""

    KIND: ClassVar[str] = "order"
    tick: _Tick
    order: Annotated[dict[str, Any], "which order"]


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkReached(RunEvent):
    """Every order sent before a `contid.control.engine.messages.Mark` was carried out or refused."""

    KIND: ClassVar[str] = "mark"
    number: Annotated[int, "of the mark"]
    tick: _Tick


@dataclass(frozen=True, slots=True, kw_only=True)
class GotoEnded(RunEvent):
    """A robot reached the target of a goto, or gave up on it."""

    KIND: ClassVar[str] = "goto"
    robot: _Robot
    arrived: Annotated[bool, "the robot holds at the target"]
    tick: _Tick


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceEnded(RunEvent):
    """The trajectory or the stream ended."""

    KIND: ClassVar[str] = "end"
    tick: _Tick
    on_end: Annotated[str, "what the robots do then"]


@dataclass(frozen=True, slots=True, kw_only=True)
class StopBegan(RunEvent):
    """All robots stop; the run ends afterwards."""

    KIND: ClassVar[str] = "stopping"
    reason: Annotated[str, "why the stop began"]
    seconds: Annotated[float, "how long the stop takes"]


@dataclass(frozen=True, slots=True, kw_only=True)
class BusAnswered(RunEvent):
    """A bus was lost, or carried out or refused an effect; its samples are in the record."""

    KIND: ClassVar[str] = "answer"
    tick: _Tick
    bus: _Bus
    lost: Annotated[str, "why the bus is lost"]
    done: Annotated[list[Any], "[robot index, effect] carried out"]
    refused: Annotated[list[Any], "[robot index, effect, message] refused by a device"]


@dataclass(frozen=True, slots=True, kw_only=True)
class BusStalled(RunEvent):
    """A bus did not answer within the tick."""

    KIND: ClassVar[str] = "stall"
    tick: _Tick
    bus: _Bus


@dataclass(frozen=True, slots=True, kw_only=True)
class BusChanged(RunEvent):
    """A bus answers again, or an effect cannot reach a lost one."""

    KIND: ClassVar[str] = "bus"
    bus: _Bus
    message: _Message


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceFaultChanged(RunEvent):
    """The fault that a device reports changed."""

    KIND: ClassVar[str] = "device"
    tick: _Tick
    axis: Annotated[str, "ROBOT.AXIS"]
    fault: Annotated[str, "fault the device reports, empty for none"]


@dataclass(frozen=True, slots=True, kw_only=True)
class StalenessChanged(RunEvent):
    """The age class of the data of a bus changed."""

    KIND: ClassVar[str] = "tier"
    tick: _Tick
    bus: _Bus
    tier: Annotated[str, "age class of the data now"]
    before: Annotated[str, "age class of the data before"]
    age_s: Annotated[float, "age of the oldest sample, or of a measurement"]


@dataclass(frozen=True, slots=True, kw_only=True)
class LimitNamed(RunEvent):
    """A bit of ``limited_by`` was assigned to a limit."""

    KIND: ClassVar[str] = "limit_name"
    robot: _Robot
    bit: Annotated[int, "bit of limited_by"]
    name: Annotated[str, "name of the limit"]


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


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotReported(RunEvent):
    """The closing report of a robot (`contid.control.engine.report.robot_reports`)."""

    KIND: ClassVar[str] = "robot"
    robot: _Robot
    report: Annotated[dict[str, Any], "mode, fault, tip errors and limits"]


@dataclass(frozen=True, slots=True, kw_only=True)
class BusReported(RunEvent):
    """What a bus counted on its wire (`contid.hal.CountsAnswers`), at the end of the run."""

    KIND: ClassVar[str] = "wire"
    bus: _Bus
    counts: Annotated[dict[str, int], "numbers of exchanges, and of answers that were late, silent or broken"]


@dataclass(frozen=True, slots=True, kw_only=True)
class LogWritten(RunEvent):
    """A log record of the daemon or of the control process."""

    KIND: ClassVar[str] = "log"
    process: Annotated[str, "daemon or control"]
    level: Annotated[str, "debug, info, warning, error or critical"]
    logger: Annotated[str, "name of the module"]
    message: _Message


@dataclass(frozen=True, slots=True, kw_only=True)
class NoteWritten(RunEvent):
    """A client related the clock of this run to its own, for recordings that are laid over each other."""

    KIND: ClassVar[str] = "note"
    experiment: Annotated[str, "name of the experiment"]
    node: Annotated[str, "name of this daemon in its fleet"]
    conductor: Annotated[str, "boot of the client's machine, from which its clock counts"]
    at_s: Annotated[float, "when the offset was measured, on the clock of deadline_s"]
    offset_s: Annotated[float, "clock of deadline_s less that of the client"]
    bound_s: Annotated[float, "largest error of the offset"]
    wall_s: Annotated[float, "time of day less the clock of the client"]
    message: _Message = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class RecorderFailed(RunEvent):
    """The control process ended without closing the ring."""

    KIND: ClassVar[str] = "recorder"
    message: _Message


@dataclass(frozen=True, slots=True, kw_only=True)
class RecorderOverrun(RunEvent):
    """The ring was overwritten before the recorder had read it."""

    KIND: ClassVar[str] = "overrun"
    missed_ticks: Annotated[int, "ticks that are not in the file"]
    missed_events: Annotated[int, "events that are not in the file"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewerPaused(RunEvent):
    """The ring was overwritten before the viewer had read it; written by the viewer."""

    KIND: ClassVar[str] = "viewer"
    message: _Message


@dataclass(frozen=True, slots=True, kw_only=True)
class EventTooLong(RunEvent):
    """Replaces an event that does not fit into the ring."""

    KIND: ClassVar[str] = "too_long"
    kind: Annotated[str, "of the event"]


@dataclass(frozen=True, slots=True, kw_only=True)
class UnknownEvent(RunEvent):
    """An event of another version, or a damaged one."""

    kind: str
    values: Mapping[str, Any]


_JSON: Final = {
    str: "string",
    int: "integer",
    float: "number",
    bool: "boolean",
    list: "array",
    dict: "object",
}


@dataclass(frozen=True, slots=True)
class EventKey:
    """A key of an event in JSON: its JSON type, its meaning, and whether every event of the kind has it."""

    json: str
    meaning: str
    required: bool


def _keys(kind: type[RunEvent]) -> dict[str, EventKey]:
    hints = get_type_hints(kind, include_extras=True)
    keys = {}
    for each in fields(kind):
        hint, meaning = get_args(hints[each.name])
        keys[each.name] = EventKey(_JSON[get_origin(hint) or hint], meaning, each.default is MISSING)
    return keys


#: Every kind of event by the value of ``event`` in its JSON, and the keys it has there.
KINDS: Final = {each.KIND: each for each in RunEvent.__subclasses__() if each.KIND}
KEYS: Final = {name: _keys(kind) for name, kind in KINDS.items()}


def to_json(event: RunEvent) -> dict[str, Any]:
    """The JSON object of an event."""
    match event:
        case OrderGiven(tick=tick, order=order):
            return {"event": event.KIND, "tick": tick, **order}
        case UnknownEvent(kind=kind, values=values):
            return {"event": kind, **values}
    return {"event": event.KIND, **{name: getattr(event, name) for name in KEYS[event.KIND]}}


def from_json(data: Mapping[str, Any]) -> RunEvent:
    """The event of a JSON object; `UnknownEvent` when it does not have the keys and types of its kind."""
    name = data["event"]
    values = {key: value for key, value in data.items() if key != "event"}
    if name == OrderGiven.KIND and "order" in values and _is(values.get("tick"), "integer"):
        return OrderGiven(tick=values.pop("tick"), order=values)
    keys = KEYS.get(name)
    if keys is None or not all(
        _is(values[key], about.json) if key in values else not about.required for key, about in keys.items()
    ):
        return UnknownEvent(kind=name, values=values)
    return KINDS[name](**{key: values[key] for key in keys if key in values})


def _is(value: object, json: str) -> bool:
    """True for a value of a JSON type."""
    if isinstance(value, bool):
        return json == "boolean"
    if json == "number":
        return isinstance(value, int | float)
    return any(isinstance(value, kind) for kind, name in _JSON.items() if name == json)
