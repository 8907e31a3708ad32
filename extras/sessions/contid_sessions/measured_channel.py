"""The channel `measured` of a session: what the robots did by their own devices, in every tick.

The tick does not compute it, and neither does the recorder while it records: compaction adds it, from the
samples of each tick, by transmission and model of the recorded robot file. A session that was not compacted,
or that an older version recorded, has no such channel; `contid session repair` adds it, to a compacted one
in a copy only (``--output``).
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from math import inf, isfinite, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

from contid.errors import ContidError
from contid.session.format import mcap_records as mcap
from contid.session.format.channels import (
    MEASURED,
    SI,
    TICK_CHANNELS,
    Field,
    add_key,
    empty_schema,
    fields,
    key_of,
)
from contid.session.format.mcap_records import MESSAGE_INSIDE
from contid.session.format.record_stream import RecordStream

if TYPE_CHECKING:
    from contid.session.read import Session
    from contid_sessions.measured import MeasuredRobot

#: Channels that it is computed from.
_SOURCES: Final = ("target", "sample")
#: Of its schema and its channel; programs that rewrite files number from 1.
NUMBER: Final = 1000
#: Of the target only the load is needed, which few runs have.
_LOAD: Final = b'"load_n"'
#: Significant digits of what is computed: 0.1 nm of a length of 100 mm; more would not be compressed.
_DIGITS: Final = ".9g"


class ModelFailedError(Exception):
    """A model, which may be that of another package, raised an error."""


class MeasuredChannel:
    """Messages of one session. Use `of`.

    Args:
        session: its head.
        robots: robots of the session, by its robot file.
    """

    def __init__(self, session: Session, robots: Sequence[MeasuredRobot]) -> None:
        self._robots = tuple(robots)
        self._keys = {
            robot.config.name: tuple(
                f"{key_of(axis)}_{SI[quantity.unit]}"
                for axis, quantity in zip(robot.config.axis_names, robot.config.quantities, strict=True)
            )
            for robot in robots
        }
        self._empty = [nan] * session.layout.packer().size
        needed = {slot for robot in robots for slot in (*robot.device_slots, *robot.load_slots)}
        self._picked: dict[str, list[Field]] = {}
        for channel in _SOURCES:
            every = fields(session.layout, session.device_units, channel)
            self._picked[channel] = [each for each in every if needed.intersection(each.slots)]

    @classmethod
    def of(cls, path: Path) -> Self | None:
        """The channel of a session; None if it has one, or this version of contid refuses its robot file.

        Raises:
            ModelFailedError: its models cannot be built.
        """
        # Here: the models are loaded when a recording has ended, not when it begins.
        from contid.session.read import Session
        from contid_sessions.measured import measured_robots

        try:
            session = Session(path)
            robots = [] if MEASURED in _first_topics(path) else measured_robots(session)
        except ContidError:
            return None
        except Exception as error:  # any error of a model
            raise ModelFailedError(repr(error)) from error
        return cls(session, robots) if robots else None

    def declaration(self) -> tuple[Any, Any]:
        """Schema and channel, as records of the ``mcap`` package."""
        from mcap import records

        text = json.dumps(measured_schema(self._keys)).encode()
        return (
            records.Schema(id=NUMBER, name=f"contid.{MEASURED}", encoding="jsonschema", data=text),
            records.Channel(NUMBER, MEASURED, "json", {}, NUMBER),
        )

    def message(self, tick: Mapping[str, bytes]) -> bytes:
        """The body of the message of a tick, from the bodies of its other messages by channel.

        Raises:
            ModelFailedError: a model raised an error.
        """
        record = list(self._empty)
        for channel in _SOURCES:
            if channel in tick and (channel != _SOURCES[0] or _LOAD in tick[channel]):
                self._fill(record, channel, json.loads(tick[channel][MESSAGE_INSIDE.size :]))
        robots: dict[str, Any] = {}
        for robot in self._robots:
            name = robot.config.name
            try:
                actuation, tip = robot.pose(record)
            except Exception as error:  # any error of a model
                raise ModelFailedError(f"{name}: {error!r}") from error
            found: dict[str, Any] = {
                key: _rounded(value)
                for key, value in zip(self._keys[name], actuation, strict=True)
                if isfinite(value)
            }
            robots[name] = found if tip is None else {**found, "tip_m": [*map(_rounded, tip)]}
        _, sequence, time_ns, published_ns = MESSAGE_INSIDE.unpack_from(tick[_SOURCES[-1]])
        data = json.dumps({"tick": sequence, "robots": robots}, separators=(",", ":")).encode()
        return MESSAGE_INSIDE.pack(NUMBER, sequence, time_ns, published_ns) + data

    def _fill(self, record: list[float], channel: str, message: Mapping[str, Any]) -> None:
        """Put what a message has into the record; what is absent or infinite stays as it is."""
        for each in self._picked[channel]:
            part: Any = message
            for key in each.path:
                part = part.get(key) if part is not None else None
            if part is None:
                continue
            values = part if each.kind == "array" else (part,)
            for slot, value in zip(each.slots, values, strict=True):
                record[slot] = nan if value is None or abs(value) == inf else float(value)


def _first_topics(path: Path) -> set[str]:
    """Channels that a file declares up to its second tick; other programs declare them one by one."""
    topics: dict[int, str] = {}
    ticks = 0
    with path.open("rb") as file:
        for opcode, body in RecordStream(file):
            if opcode == mcap.CHANNEL:
                channel = mcap.decode(opcode, body)
                topics[channel.id] = channel.topic
            elif opcode == mcap.MESSAGE:
                ticks += topics.get(int.from_bytes(body[:2], "little")) == TICK_CHANNELS[0]
                if ticks > 1:
                    break
    return {*topics.values()}


def _rounded(value: float) -> float:
    return float(format(value, _DIGITS))


def measured_schema(keys: Mapping[str, Sequence[str]]) -> dict[str, Any]:
    """JSON Schema of the channel `MEASURED`: keys of the axes by robot, and its tip."""
    root: dict[str, Any] = {"title": f"contid.{MEASURED}", **empty_schema()}
    add_key(root, "tick", {"type": "integer", "description": "number of the tick"}, required=True)
    robots = add_key(root, "robots", empty_schema(), required=True)
    for name, axes in keys.items():
        robot = add_key(robots, name, empty_schema(), required=True)
        for key in axes:
            about = {"type": "number", "description": "measured actuation, by the transmission"}
            add_key(robot, key, about, required=False)
        meaning = "tip of the model at the measured actuation, with the known load, in the world frame"
        tip = {"type": "array", "description": meaning, "items": {"type": "number"}}
        add_key(robot, "tip_m", {**tip, "minItems": 3, "maxItems": 3}, required=False)
    return root
