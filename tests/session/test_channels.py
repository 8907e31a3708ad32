"""A record is decoded from its messages bit for bit, for all numbers and revisions."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

from contid.control.engine.tick_layout import AXIS, DEADLINE, HEAD, ROBOT, RecordLayout, RobotLayout
from contid.control.tick.supervisor import Mode
from contid.session.format.channels import INFINITE, TICK_CHANNELS, fields, schema
from contid.session.format.decode import MAX_COUNT, Decoder
from contid.session.format.encode import Encoder
from contid_sessions.columns import Column, channel_columns

LAYOUT = RecordLayout(
    "two", 200.0, (RobotLayout("thumb", "rack_finger", "mm", ("left", "right")),
                   RobotLayout("arm", "cosserat", "bar", ("s1.p1",)))
)  # fmt: skip
UNITS = {"thumb.left": "rad", "thumb.right": "rad", "arm.s1.p1": "pa"}
PACKED = LAYOUT.packer()
SIZE = PACKED.size // 8
FIELDS = {channel: list(fields(LAYOUT, UNITS, channel)) for channel in TICK_CHANNELS}
VECTORS = [each.slots for some in FIELDS.values() for each in some if each.kind == "array"]
VALIDATORS = {
    channel: Draft202012Validator(schema(LAYOUT, UNITS, channel), format_checker=None)
    for channel in TICK_CHANNELS
}


def _record(numbers: list[float], counts: list[int], vectors: list[bool]) -> tuple[float, ...]:
    values: list[float] = []
    source, whole = iter(numbers), iter(counts)
    values += [next(whole), next(whole), *(next(source) for _ in range(HEAD.size - 2))]
    for robot in LAYOUT.robots:
        values += [next(whole) for _ in range(5)]
        values += [next(source) for _ in range(ROBOT.size - 5)]
        for _ in robot.axes:
            axis = [next(source) for _ in range(AXIS.size)]
            axis[AXIS.place("limits")] = float(next(whole) % 16)
            axis[AXIS.place("valid")] = float(next(whole) % 2)
            values += axis
    for slots, there in zip(VECTORS, vectors, strict=True):  # a vector is present completely or not at all
        for slot in slots:
            values[slot] = values[slot] if there and math.isfinite(values[slot]) else float(there) * math.e
        if not there:
            values[slots[0]] = values[slots[1]] = values[slots[2]] = math.nan
    if not abs(values[DEADLINE]) < MAX_COUNT:  # a tick has a time
        values[DEADLINE] = 0.0
    return tuple(PACKED.unpack(PACKED.pack(*values)))


RECORDS = st.builds(
    _record,
    st.lists(st.floats(allow_nan=True, allow_infinity=True), min_size=SIZE, max_size=SIZE),
    st.lists(st.integers(0, 2**52), min_size=SIZE, max_size=SIZE),
    st.lists(st.booleans(), min_size=len(VECTORS), max_size=len(VECTORS)),
)


def _decoded(messages: list[bytes]) -> bytes:
    decoder = Decoder(LAYOUT, UNITS)
    gathered: list[Any] = []
    for channel, data in zip(TICK_CHANNELS, messages, strict=True):
        decoder.gather(gathered, channel, data)
    return PACKED.pack(*decoder.record(gathered))


def _packed(values: tuple[float, ...]) -> bytes:
    return PACKED.pack(
        *(math.nan if value != value else value for value in values)
    )  # NaN has no sign in JSON


def _refuse(constant: str) -> float:
    raise AssertionError(f"{constant} is no JSON")


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(RECORDS)
def test_round_trip_is_exact_and_matches_the_schema(values: tuple[float, ...]) -> None:
    messages = Encoder(LAYOUT, UNITS).encode(values)
    assert _decoded(messages) == _packed(values)
    for channel, data in zip(TICK_CHANNELS, messages, strict=True):
        VALIDATORS[channel].validate(json.loads(data, parse_constant=_refuse))
        assert b"null" not in data
        assert not any(token in data for token in (b"1e999", b"inf,", b"nan"))


def _of_an_earlier_revision(channel: str, values: tuple[float, ...], revision: int) -> bytes:
    """A message of revisions 0 and 1: every key, null for absent values, 1e999 for infinity."""
    message: dict[str, Any] = {}
    for each in FIELDS[channel]:
        if revision == 0 and each.path[-1].startswith("measured_"):
            continue
        at = message
        for key in each.path[:-1]:
            at = at.setdefault(key, {})
        numbers = [None if values[slot] != values[slot] else values[slot] for slot in each.slots]
        vector = numbers if any(number is not None for number in numbers) else None
        plain = bool(numbers[0]) if each.kind == "boolean" else numbers[0]
        at[each.path[-1]] = vector if each.kind == "array" else plain
    return json.dumps(message).replace("Infinity", "1e999").encode()


@pytest.mark.parametrize("revision", [0, 1])
@settings(max_examples=20, deadline=None)
@given(RECORDS)
def test_messages_of_earlier_revisions_are_read(revision: int, values: tuple[float, ...]) -> None:
    known = list(values)
    if revision == 0:
        for each in FIELDS["sample"]:
            if each.path[-1].startswith("measured_"):
                for slot in each.slots:
                    known[slot] = math.nan
    messages = [_of_an_earlier_revision(channel, values, revision) for channel in TICK_CHANNELS]
    assert _decoded(messages) == _packed(tuple(known))


def test_every_value_of_a_record_is_in_exactly_one_message() -> None:
    slots = [slot for some in FIELDS.values() for each in some for slot in each.slots]
    assert sorted(slots) == sorted([*range(SIZE), *(0,) * (len(TICK_CHANNELS) - 1)])


def _keys(part: dict[str, Any], path: str = "") -> Iterator[str]:
    for key, value in part.items():
        yield f"{path}/{key}"
        if isinstance(value, dict):
            yield from _keys(value, f"{path}/{key}")


def _promised(part: dict[str, Any], which: str, path: str = "") -> Iterator[str]:
    for key in part[which]:
        yield f"{path}/{key}"
        if part["properties"][key]["type"] == "object":
            yield from _promised(part["properties"][key], which, f"{path}/{key}")


def test_a_full_record_has_every_key_of_the_schema_and_an_empty_one_those_that_are_required() -> None:
    full = PACKED.unpack(PACKED.pack(*range(SIZE)))
    integers = {each.slots[0] for some in FIELDS.values() for each in some if each.required}
    empty = tuple(value if slot in integers else math.nan for slot, value in enumerate(full))
    encoder = Encoder(LAYOUT, UNITS)
    for number, channel in enumerate(TICK_CHANNELS):
        about = schema(LAYOUT, UNITS, channel)
        Draft202012Validator.check_schema(about)
        known = {*_promised(about, "properties")} - {f"/{INFINITE}"}
        assert {*_keys(json.loads(encoder.encode(full)[number]))} == known
        required = {*_promised(about, "required")}
        assert {*_keys(json.loads(encoder.encode(empty)[number]))} == required < known


def test_schemas_are_strict() -> None:
    values = PACKED.unpack(PACKED.pack(*range(SIZE)))
    for channel, data in zip(TICK_CHANNELS, Encoder(LAYOUT, UNITS).encode(values), strict=True):
        message = json.loads(data)
        assert VALIDATORS[channel].is_valid(message)
        robot = message["robots"]["thumb"]
        for wrong in ({"more": 1}, dict.fromkeys(robot, None)):
            assert not VALIDATORS[channel].is_valid(
                {**message, "robots": {**message["robots"], "thumb": {**robot, **wrong}}}
            )
        assert not VALIDATORS[channel].is_valid({**message, "more": 1})
        assert not VALIDATORS[channel].is_valid({"tick": 1, "robots": {"thumb": robot}})


def test_modes_have_their_names_in_the_schema() -> None:
    (message,) = {each.meaning for each in FIELDS["tick"] if each.path[-1] == "mode"}
    assert message == ", ".join(f"{mode.value} {mode.name}" for mode in Mode)


def test_infinite_numbers_are_named() -> None:
    values = list(PACKED.unpack(PACKED.pack(*range(SIZE))))
    slots = {"/".join(each.path): each.slots[0] for each in FIELDS["sample"]}
    values[slots["robots/thumb/left/age_s"]] = math.inf
    values[slots["robots/arm/s1_p1/effort"]] = -math.inf
    message = json.loads(Encoder(LAYOUT, UNITS).encode(values)[TICK_CHANNELS.index("sample")])
    assert message[INFINITE] == ["robots/thumb/left/age_s", "-robots/arm/s1_p1/effort"]
    assert "age_s" not in message["robots"]["thumb"]["left"]


def test_a_vector_with_one_infinite_component_is_absent_as_a_whole() -> None:
    values = list(PACKED.unpack(PACKED.pack(*range(SIZE))))
    x, y, z = next(each.slots for each in FIELDS["target"] if each.path == ("robots", "thumb", "tip_m"))
    values[y] = math.inf
    messages = Encoder(LAYOUT, UNITS).encode(values)
    message = json.loads(messages[TICK_CHANNELS.index("target")])
    assert "tip_m" not in message["robots"]["thumb"]
    assert INFINITE not in message
    decoded = PACKED.unpack(_decoded(messages))
    assert [math.isnan(decoded[slot]) for slot in (x - 1, x, y, z, z + 1)] == [False, True, True, True, False]


def test_the_caches_of_patterns_are_bounded() -> None:
    encoder = Encoder(LAYOUT, UNITS)
    source = next(each.slots[0] for each in FIELDS["tick"] if each.path == ("source_s",))
    optional = [source, *(each.slots[0] for each in FIELDS["sample"] if each.kind == "number")]
    for number in range(400):
        values = list(PACKED.unpack(PACKED.pack(*(0,) * SIZE)))
        for bit, slot in enumerate(optional[:10]):
            values[slot] = math.nan if number >> bit & 1 else values[slot]
        assert _decoded(encoder.encode(values)) == _packed(tuple(values))
    assert len(encoder._forms) <= 256


@pytest.mark.parametrize(
    "wrong",
    [b"[]", b"5", b'{"tick":1}', b'{"tick":1,"robots":5}', b'{"tick":1,"robots":{"thumb":[],"arm":[]}}',
     b'{"tick":1,"infinite":[5],"robots":{}}', b'{"tick":1,"infinite":["a/b"],"robots":{}}',
     b'{"tick":1,"infinite":5,"robots":{"thumb":{},"arm":{}}}',
     b'{"tick":1,"robots":{"thumb":{"tip_m":[1,2]},"arm":{}}}',
     b'{"tick":1,"robots":{"thumb":{"tip_m":[1,2,3,4]},"arm":{}}}',
     b'{"tick":1,"robots":{"thumb":{"tip_m":"abc"},"arm":{}}}',
     b'{"tick":1,"robots":{"thumb":{"left_m":"far"},"arm":{}}}'],
)  # fmt: skip
def test_invalid_messages_are_damage(wrong: bytes) -> None:
    from contid.session.format.entries import _DAMAGE

    messages = Encoder(LAYOUT, UNITS).encode(PACKED.unpack(PACKED.pack(*range(SIZE))))
    messages[TICK_CHANNELS.index("target")] = wrong
    with pytest.raises(_DAMAGE):
        _decoded(messages)


def test_bits_of_an_axis_whose_name_ends_like_a_unit_are_not_converted() -> None:
    layout = RecordLayout("arm", 200.0, (RobotLayout("arm", "rack_finger", "mm", ("reach_m",)),))
    session = SimpleNamespace(layout=layout, device_units={"arm.reach_m": "rad"})
    columns = {column.name: column for column in channel_columns(session, "command")}
    place = layout.axis_place(0, 0, "limits")
    assert columns["arm.limits.reach_m"] == Column("arm.limits.reach_m", place, None, is_integer=True)
