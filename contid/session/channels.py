"""What the channels of a session hold: which number of a record goes where in which JSON message, and back.

A tick leaves one message on each of `TICK_CHANNELS`; ``event`` has one per event. Values are SI with the unit
in the key (``left_m``, ``p1_pa``, ``tip_m``); a dot in an axis name becomes an underscore, so that plotting
programs find the way. ``null`` is what a record has as NaN: absent. Floats are written with the fewest
digits that read back to the same float64, so nothing is lost between the tick and its replay. Its
`REVISION` tells which keys a file has.
"""

from __future__ import annotations

import json
import math
import re
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from operator import itemgetter
from typing import Any, Final

from contid.control.record import AXIS_VALUES, HEAD_VALUES, ROBOT_VALUES, RecordLayout

TICK_CHANNELS: Final = ("tick", "target", "solution", "command", "sample")
EVENT: Final = "event"
#: Grows with keys that an older reader leaves out and a newer one misses in older files:
#: 1 the measured tip of every robot.
REVISION: Final = 1
CHANNELS: Final = (*TICK_CHANNELS, EVENT)
#: Unit in a robot file -> unit of SI.
SI: Final = {"mm": "m", "bar": "pa"}

# Places in a record, relative to its robot and to its axis (`contid.control.record`).
_MODE, _FAULT, _FLAGS, _LIMITED_BY, _ITERATIONS = range(5)
_TIP, _DIRECTION, _MID, _LOAD = (5, 6, 7), (8, 9, 10), (11, 12, 13), (14, 15, 16)
_RESIDUAL, _TIP_ERROR = 17, 18
_MEASURED_TIP, _MEASURED_DIRECTION, _MEASURED_AGE = (19, 20, 21), (22, 23, 24), 25
TARGET, SOLUTION, COMMAND, LIMITS, DEVICE = range(5)
VALUE, TIME, VALID, AGE, VELOCITY, EFFORT, TEMPERATURE, VOLTAGE = range(5, 13)

_VOID: Final = "[null,null,null]"
_NAN: Final = math.nan


@dataclass(frozen=True, slots=True)
class Field:
    """One value of a message.

    Attributes:
        path: keys from the message down to it.
        slots: places in the record; three make a vector.
        kind: JSON Schema type of it.
        words: what it is, for the schema.
        since: first revision that has it.
    """

    path: tuple[str, ...]
    slots: tuple[int, ...]
    kind: str
    words: str
    since: int = 0


def robot_at(layout: RecordLayout, index: int) -> int:
    """Place of the first value of a robot in a record."""
    before = sum(ROBOT_VALUES + AXIS_VALUES * len(robot.axes) for robot in layout.robots[:index])
    return HEAD_VALUES + before


def axis_at(layout: RecordLayout, robot: int, axis: int) -> int:
    """Place of the first value of an axis in a record."""
    return robot_at(layout, robot) + ROBOT_VALUES + AXIS_VALUES * axis


def key_of(axis: str) -> str:
    """An axis name as it stands in keys."""
    return axis.replace(".", "_")


def fields(layout: RecordLayout, device_units: Mapping[str, str], channel: str) -> Iterator[Field]:
    """Every value of a channel's messages, in order.

    Args:
        layout: of the records.
        device_units: ``rad`` or ``pa`` by ``ROBOT.AXIS``.
        channel: one of `TICK_CHANNELS`.
    """
    yield Field(("tick",), (0,), "integer", "number of the tick")
    if channel == "tick":
        yield Field(("skipped",), (1,), "integer", "ticks skipped so far")
        for slot, name, words in (
            (2, "deadline_s", "when it should have started, on CLOCK_MONOTONIC or in virtual time"),
            (3, "lateness_s", "how much later it started"),
            (4, "work_s", "how long it took"),
            (5, "source_s", "time in the trajectory"),
        ):
            yield Field((name,), (slot,), "number", words)
    for index, robot in enumerate(layout.robots):
        at, front, unit = robot_at(layout, index), ("robots", robot.name), SI[robot.quantity]
        for place, name, kind, words in _OF_ROBOT[channel]:
            slots = tuple(at + each for each in (place if isinstance(place, tuple) else (place,)))
            yield Field((*front, name), slots, kind, words, _SINCE.get(name, 0))
        for number, axis in enumerate(robot.axes):
            start, key = axis_at(layout, index, number), key_of(axis)
            device = device_units[f"{robot.name}.{axis}"]
            if channel == "sample":
                for place, name, kind, words in _SAMPLE:
                    full = name.format(unit=device)
                    yield Field((*front, key, full), (start + place,), kind, words)
            elif channel in _ACTUATION:
                place, words = _ACTUATION[channel]
                yield Field((*front, f"{key}_{unit}"), (start + place,), "number", words)
        if channel == "command":
            for number, axis in enumerate(robot.axes):
                start, key = axis_at(layout, index, number), key_of(axis)
                path = (*front, "device", f"{key}_{device_units[f'{robot.name}.{axis}']}")
                yield Field(path, (start + DEVICE,), "number", "value sent to the device")
                words = "bits: 1 position, 2 velocity, 4 acceleration, 8 refused"
                yield Field((*front, "limits", key), (start + LIMITS,), "integer", words)


_OF_ROBOT: Final[dict[str, tuple[tuple[int | tuple[int, ...], str, str, str], ...]]] = {
    "tick": (
        (_MODE, "mode", "integer", "contid.control.supervisor.Mode"),
        (_FAULT, "fault", "integer", "contid.control.faults.Fault"),
        (_FLAGS, "flags", "integer", "bits: 1 has a target, 2 converged, 4 devices enabled"),
    ),
    "target": (
        (_TIP, "tip_m", "array", "tip position in the world frame"),
        (_DIRECTION, "direction", "array", "unit tangent at the tip in the world frame"),
        (_MID, "mid_m", "array", "mid-point in the world frame"),
        (_LOAD, "load_n", "array", "known force on the tip in the world frame"),
    ),
    "solution": (
        (_RESIDUAL, "residual_m", "number", "distance of what the model reaches from the target"),
        (_ITERATIONS, "iterations", "integer", "steps of the solver"),
        (_LIMITED_BY, "limited_by", "integer", "bits; events 'limit_name' say what they stand for"),
    ),
    "command": ((_TIP_ERROR, "tip_error_m", "number", "distance of the commanded model's tip"),),
    "sample": (
        (_MEASURED_TIP, "measured_tip_m", "array", "where a tracker saw the tip, world frame"),
        (_MEASURED_DIRECTION, "measured_direction", "array", "unit tangent it saw there, world frame"),
        (_MEASURED_AGE, "measured_age_s", "number", "since that was captured"),
    ),
}
_SINCE: Final = dict.fromkeys(("measured_tip_m", "measured_direction", "measured_age_s"), 1)
_ACTUATION: Final = {
    "target": (TARGET, "actuation the target asked for"),
    "solution": (SOLUTION, "actuation the model answered"),
    "command": (COMMAND, "actuation commanded after the limits"),
}
_SAMPLE: Final = (
    (VALUE, "value_{unit}", "number", "what the device reported"),
    (TIME, "time_s", "number", "when it was measured, on the clock of deadline_s"),
    (VALID, "valid", "boolean", "the newest exchange read it"),
    (AGE, "age_s", "number", "its age at the end of that exchange"),
    (VELOCITY, "velocity_{unit}_s", "number", "velocity the device reported"),
    (EFFORT, "effort", "number", "current [A] of servos and motors, duty of regulators"),
    (TEMPERATURE, "temperature_c", "number", "temperature of the device"),
    (VOLTAGE, "voltage_v", "number", "supply of the device"),
)


def schema(layout: RecordLayout, device_units: Mapping[str, str], channel: str) -> dict[str, Any]:
    """JSON Schema of a channel."""
    if channel == EVENT:
        keys = {"event": {"type": "string"}, "tick": {"type": "integer"}}
        return {"type": "object", "title": f"contid.{EVENT}", "properties": keys, "required": ["event"]}
    root: dict[str, Any] = {"type": "object", "title": f"contid.{channel}", "properties": {}}
    for each in fields(layout, device_units, channel):
        at = root["properties"]
        for key in each.path[:-1]:
            at = at.setdefault(key, {"type": "object", "properties": {}})["properties"]
        about: dict[str, Any] = {"type": each.kind, "description": each.words}
        if each.kind == "array":
            about |= {"items": {"type": "number"}, "minItems": 3, "maxItems": 3}
        at[each.path[-1]] = about
    return root


def _number(value: float) -> str:
    """A number as JSON; 1e999 is how JSON says infinity and be read as one."""
    if value - value == 0:
        return repr(value)
    return "null" if value != value else "1e999" if value > 0 else "-1e999"


@dataclass(slots=True)
class Encoder:
    """Records to messages: one text per channel with places for the numbers, filled in one step."""

    layout: RecordLayout
    device_units: Mapping[str, str]
    _parts: list[tuple[str, Callable[[list[str]], tuple[str, ...]]]] = field(default_factory=list)
    _flags: tuple[int, ...] = ()
    _integers: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        """Prepare the texts."""
        every = [list(fields(self.layout, self.device_units, channel)) for channel in TICK_CHANNELS]
        known = [each for some in every for each in some]
        self._flags = tuple(each.slots[0] for each in known if each.kind == "boolean")
        limits = [each for each in known if "limits" in each.path]
        self._integers = tuple(each.slots[0] for each in limits)
        self._parts = [_template(some) for some in every]

    def encode(self, values: Sequence[float]) -> list[bytes]:
        """One message per channel of `TICK_CHANNELS`."""
        texts = [_number(value) for value in values]
        for slot in self._flags:
            texts[slot] = "true" if values[slot] else "false"
        for slot in self._integers:
            texts[slot] = str(int(values[slot]))
        return [(text % pick(texts)).replace(_VOID, "null").encode() for text, pick in self._parts]


def _template(some: Sequence[Field]) -> tuple[str, Callable[[list[str]], tuple[str, ...]]]:
    root: dict[str, Any] = {}
    for each in some:
        at = root
        for key in each.path[:-1]:
            at = at.setdefault(key, {})
        marks = [f"@{slot}@" for slot in each.slots]
        at[each.path[-1]] = marks if each.kind == "array" else marks[0]
    text = json.dumps(root, separators=(",", ":")).replace("%", "%%")
    slots = [int(slot) for slot in re.findall(r'"@(\d+)@"', text)]
    return re.sub(r'"@\d+@"', "%s", text), _picker(slots)


def _picker(slots: Sequence[Any]) -> Callable[[Any], tuple[Any, ...]]:
    if len(slots) == 1:
        return lambda values: (values[slots[0]],)
    return itemgetter(*slots)


@dataclass(frozen=True, slots=True)
class _Group:
    """Values of one object of a message: first its numbers, then its vectors."""

    path: tuple[str, ...]
    numbers: Callable[[Any], tuple[Any, ...]] | None
    vectors: tuple[str, ...]
    slots: tuple[int, ...]


class Decoder:
    """Messages back to records: gathered as they come, put in order once per tick."""

    def __init__(
        self, layout: RecordLayout, device_units: Mapping[str, str], revision: int = REVISION
    ) -> None:
        self._groups: dict[str, list[_Group]] = {}
        order: dict[int, int] = {}
        missing: list[int] = []
        gathered = 0
        for channel in TICK_CHANNELS:
            by_path: dict[tuple[str, ...], list[Field]] = {}
            for each in fields(layout, device_units, channel):
                if each.since <= revision:
                    by_path.setdefault(each.path[:-1], []).append(each)
                else:
                    missing += each.slots
            self._groups[channel] = [_group(path, some) for path, some in by_path.items()]
            for group in self._groups[channel]:
                order |= {slot: gathered + place for place, slot in enumerate(group.slots)}
                gathered += len(group.slots)
        # What a file of an earlier revision has not is absent: the one None after all that was gathered.
        order |= dict.fromkeys(missing, gathered)
        self._complete = not missing
        self._arrange = itemgetter(*(order[slot] for slot in sorted(order)))
        self._decode = json.JSONDecoder().decode

    def gather(self, gathered: list[Any], channel: str, data: bytes) -> None:
        """Add what a message holds; the messages of a tick in the order of `TICK_CHANNELS`.

        Raises:
            ValueError, KeyError, TypeError: it is not a message of this channel.
        """
        message = self._decode(data.decode())
        for group in self._groups[channel]:
            part = message
            for key in group.path:
                part = part[key]
            if group.numbers is not None:
                gathered += group.numbers(part)
            for key in group.vectors:
                gathered += part[key] or _NO_VECTOR

    def record(self, gathered: Sequence[Any]) -> list[float]:
        """The record of the gathered messages.

        Raises:
            IndexError: one is missing.
            struct.error, OverflowError: one is no number that a record can hold.
        """
        whole = gathered if self._complete else [*gathered, None]
        values = [_NAN if value is None else value for value in self._arrange(whole)]
        # Cheaper than looking at each: only numbers can be packed.
        struct.pack(f"{len(values)}d", *values)
        return values


_NO_VECTOR: Final = (None, None, None)


def _group(path: tuple[str, ...], some: Sequence[Field]) -> _Group:
    numbers = [each for each in some if each.kind != "array"]
    vectors = [each for each in some if each.kind == "array"]
    slots = tuple(slot for each in (*numbers, *vectors) for slot in each.slots)
    pick = _picker([each.path[-1] for each in numbers]) if numbers else None
    return _Group(path, pick, tuple(each.path[-1] for each in vectors), slots)
