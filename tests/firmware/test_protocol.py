"""The numbers of the protocol are the same in the driver and in the sketch."""

from __future__ import annotations

import enum
import re

import pytest

from contid_drivers.due import codes
from contid_drivers.due.firmware import firmware_dir

HEADER = (firmware_dir() / "contid_due" / "src" / "core" / "protocol.h").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("in_sketch", "in_driver"),
    [
        ("Message", codes.Type),
        ("Role", codes.RoleCode),
        ("Rest", codes.RestCode),
        ("Safe", codes.SafeCode),
        ("State", codes.BoardState),
        ("Reason", codes.Reason),
        ("Refusal", codes.Refusal),
        ("ResetCause", codes.ResetCause),
    ],
)
def test_every_name_has_one_number(in_sketch: str, in_driver: type[enum.IntEnum]) -> None:
    (body,) = re.findall(rf"enum (?:class )?{in_sketch} : uint8_t {{(.*?)}};", HEADER, re.DOTALL)
    numbers = {name: int(number, 0) for name, number in re.findall(r"(\w+) = (\w+)", body)}
    if in_driver is codes.Refusal:
        # An answer that refuses nothing is no refusal; the driver has no word for it.
        assert numbers.pop("NONE") == 0
    assert numbers == {each.name: each.value for each in in_driver}


@pytest.mark.parametrize(
    "name",
    [
        "PROTOCOL_VERSION", "CHANNELS", "DUTY_FULL", "CHANNEL_HOMED", "CHANNEL_LIMITED", "CHANNEL_SENSOR_OK",
        "BOARD_CONFIGURED", "BOARD_DEMAND_STALE",
    ],
)  # fmt: skip
def test_every_constant_is_the_same(name: str) -> None:
    (number,) = re.findall(rf"const \w+ {name} = (\w+);", HEADER)
    assert getattr(codes, name) == int(number, 0)
