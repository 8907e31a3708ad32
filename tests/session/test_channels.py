"""A record comes back from its messages bit for bit, whatever its numbers are."""

from __future__ import annotations

import json
import math

from hypothesis import given, settings
from hypothesis import strategies as st

from contid.control.record import AXIS_VALUES, HEAD_VALUES, ROBOT_VALUES, RecordLayout, RobotLayout
from contid.session.channels import TICK_CHANNELS, Decoder, Encoder, fields, schema

LAYOUT = RecordLayout(
    "two", 200.0, (RobotLayout("thumb", "rack_finger", "mm", ("left", "right")),
                   RobotLayout("arm", "cosserat", "bar", ("s1.p1",)))
)  # fmt: skip
UNITS = {"thumb.left": "rad", "thumb.right": "rad", "arm.s1.p1": "pa"}
PACKED = LAYOUT.packer()


def _record(numbers: list[float], counts: list[int]) -> tuple[float, ...]:
    values: list[float] = []
    source, whole = iter(numbers), iter(counts)
    values += [next(whole), next(whole), *(next(source) for _ in range(HEAD_VALUES - 2))]
    for robot in LAYOUT.robots:
        values += [next(whole) for _ in range(5)]
        values += [next(source) for _ in range(ROBOT_VALUES - 5)]
        for _ in robot.axes:
            axis = [next(source) for _ in range(AXIS_VALUES)]
            axis[3], axis[7] = float(next(whole) % 16), float(next(whole) % 2)
            values += axis
    return tuple(PACKED.unpack(PACKED.pack(*values)))


SIZE = PACKED.size // 8
RECORDS = st.builds(
    _record,
    st.lists(st.floats(allow_nan=True, allow_infinity=True), min_size=SIZE, max_size=SIZE),
    st.lists(st.integers(0, 2**52), min_size=SIZE, max_size=SIZE),
)


@settings(max_examples=200, deadline=None)
@given(RECORDS)
def test_round_trip_is_exact(values: tuple[float, ...]) -> None:
    encoder, decoder = Encoder(LAYOUT, UNITS), Decoder(LAYOUT, UNITS)
    gathered: list[object] = []
    for channel, data in zip(TICK_CHANNELS, encoder.encode(values), strict=True):
        decoder.gather(gathered, channel, data)
    back = decoder.record(gathered)
    same = [math.nan if value != value else value for value in values]  # a NaN has no sign in JSON
    assert PACKED.pack(*back) == PACKED.pack(*same)


@settings(max_examples=20, deadline=None)
@given(RECORDS)
def test_what_a_file_of_an_earlier_revision_lacks_is_absent(values: tuple[float, ...]) -> None:
    later = {
        slot
        for channel in TICK_CHANNELS
        for each in fields(LAYOUT, UNITS, channel)
        if each.since
        for slot in each.slots
    }
    encoder, decoder = Encoder(LAYOUT, UNITS), Decoder(LAYOUT, UNITS, revision=0)
    gathered: list[object] = []
    for channel, data in zip(TICK_CHANNELS, encoder.encode(values), strict=True):
        message = json.loads(data)
        for robot in message.get("robots", {}).values():
            for key in [key for key in robot if key.startswith("measured_")]:
                del robot[key]
        decoder.gather(gathered, channel, json.dumps(message).encode())
    back = decoder.record(gathered)
    assert len(later) == 7 * len(LAYOUT.robots)
    same = [math.nan if k in later or value != value else value for k, value in enumerate(values)]
    assert PACKED.pack(*back) == PACKED.pack(*same)


def test_every_value_of_a_record_is_in_exactly_one_message() -> None:
    slots = [
        slot for channel in TICK_CHANNELS for each in fields(LAYOUT, UNITS, channel) for slot in each.slots
    ]
    assert sorted(slots) == sorted([*range(SIZE), *(0,) * (len(TICK_CHANNELS) - 1)])


def test_messages_match_their_schema() -> None:
    def keys(part: dict[str, object]) -> dict[str, object]:
        return {k: keys(v) if isinstance(v, dict) else None for k, v in part.items()}

    def promised(part: dict[str, dict[str, object]]) -> dict[str, object]:
        return {
            k: promised(v["properties"]) if v["type"] == "object" else None  # type: ignore[arg-type]
            for k, v in part.items()
        }

    values = PACKED.unpack(PACKED.pack(*range(SIZE)))
    for channel, data in zip(TICK_CHANNELS, Encoder(LAYOUT, UNITS).encode(values), strict=True):
        assert keys(json.loads(data)) == promised(schema(LAYOUT, UNITS, channel)["properties"])
