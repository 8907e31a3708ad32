"""Telemetry encoded once for many subscribers is what each of them asked for."""

from __future__ import annotations

import json
import math
from types import SimpleNamespace
from typing import Any, cast

from hypothesis import given
from hypothesis import strategies as some

from contid.control.engine.tick_layout import TickRecord
from contid.remote.server.frame_encoder import FrameEncoder

ROBOTS = ("left", "rechts ü", 'quote"')
FIELDS = ("state", "tip_mm", "fault", "error_mm")


def value(tick: int, robot: str, field: str) -> Any:
    match field:
        case "state":
            return f"RUN {robot}"
        case "tip_mm":
            return [float(tick), math.nan if tick % 2 else 0.1, len(robot)]
        case "fault":
            return tick % 3
    return None


def names(choices: tuple[str, ...]) -> some.SearchStrategy[tuple[str, ...]]:
    return some.lists(some.sampled_from(choices), unique=True, min_size=1).map(tuple)


@given(some.lists(some.tuples(some.integers(0, 4), names(ROBOTS), names(FIELDS)), max_size=20))
def test_frames_are_those_of_single_subscribers(asked: list[tuple[int, Any, Any]]) -> None:
    asked.sort(key=lambda item: item[0])
    encoder = FrameEncoder(lambda record, robot, field: value(record.tick, robot, field))
    for tick, robots, fields in asked:
        record = cast(TickRecord, SimpleNamespace(tick=tick, deadline_s=tick / 7.0))
        expected = {
            "event": "telemetry",
            "tick": tick,
            "t_s": tick / 7.0,
            "robots": {
                robot: {
                    field: [None if v != v else v for v in found] if isinstance(found, list) else found
                    for field in fields
                    for found in [value(tick, robot, field)]
                }
                for robot in robots
            },
        }
        line = encoder.line(record, robots, fields)
        assert line.endswith(b"}\n")
        assert json.loads(line) == expected


def test_a_value_that_two_subscribers_share_is_computed_once_per_tick() -> None:
    computed: list[tuple[int, str, str]] = []

    def field_of(record: TickRecord, robot: str, field: str) -> Any:
        computed.append((record.tick, robot, field))
        return value(record.tick, robot, field)

    encoder = FrameEncoder(field_of)
    for tick in range(3):
        record = cast(TickRecord, SimpleNamespace(tick=tick, deadline_s=0.0))
        for fields in (FIELDS, FIELDS[1:], FIELDS[:2], FIELDS):
            encoder.line(record, ROBOTS, fields)
    assert len(computed) == len(set(computed)) == 3 * len(ROBOTS) * len(FIELDS)
