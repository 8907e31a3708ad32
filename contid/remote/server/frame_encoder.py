"""Telemetry as lines: what several subscribers of a tick get is computed and encoded once."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any, TypeAlias

from contid.control.engine.tick_layout import TickRecord
from contid.remote.protocol.wire import encode

#: The value of one field of one robot in a record.
FieldOf: TypeAlias = Callable[[TickRecord, str, str], Any]


class FrameEncoder:
    """Encodes telemetry of the newest tick."""

    def __init__(self, field_of: FieldOf) -> None:
        """Encode the values of ``field_of(record, robot, field)``."""
        self._field_of = field_of
        self._tick = -1
        self._head = b""
        self._parts: dict[tuple[str, str], bytes] = {}
        self._lines: dict[tuple[tuple[str, ...], tuple[str, ...]], bytes] = {}

    def line(self, record: TickRecord, robots: tuple[str, ...], fields: tuple[str, ...]) -> bytes:
        """One frame: the chosen fields of the chosen robots at the tick of the record."""
        if record.tick != self._tick:
            self._tick = record.tick
            head = encode({"event": "telemetry", "tick": record.tick, "t_s": record.deadline_s})
            self._head = head[:-2] + b',"robots":{'
            self._parts.clear()
            self._lines.clear()
        line = self._lines.get((robots, fields))
        if line is None:
            parts = (
                b"%s:{%s}"
                % (
                    json.dumps(robot).encode(),
                    b",".join([self._part(record, robot, field) for field in fields]),
                )
                for robot in robots
            )
            line = self._lines[robots, fields] = self._head + b",".join(parts) + b"}}\n"
        return line

    def _part(self, record: TickRecord, robot: str, field: str) -> bytes:
        part = self._parts.get((robot, field))
        if part is None:
            value = encode({field: self._field_of(record, robot, field)})
            part = self._parts[robot, field] = value[1:-2]  # without the braces
        return part
