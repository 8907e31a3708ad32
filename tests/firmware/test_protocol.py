"""protocol.h is the reference of the protocol's numbers: the driver and PROTOCOL.md agree with it."""

from __future__ import annotations

import enum
import re

import pytest

from contid_devices.due.firmware_build import firmware_dir
from contid_drivers.due import codes
from contid_drivers.due.motor_options import Bridge
from contid_drivers.due.options import Role, SafeState
from contid_drivers.due.wiring import MOTOR_FIELDS, REGULATOR_FIELDS, TENSION_FIELDS

CORE = firmware_dir() / "contid_due" / "src" / "core"
HEADER = (CORE / "protocol.h").read_text(encoding="utf-8")
PAGE = (firmware_dir() / "PROTOCOL.md").read_text(encoding="utf-8")
ENUMS = {
    "Message": codes.Type,
    "Role": Role,
    "Rest": codes.RestCode,
    "Safe": SafeState,
    "Bridge": Bridge,
    "State": codes.BoardState,
    "Reason": codes.Reason,
    "Refusal": codes.Refusal,
    "ResetCause": codes.ResetCause,
}
STRUCT_CODES = {"u8": "B", "i16": "h", "u16": "H", "i32": "i"}


def enum_of(name: str) -> dict[str, int]:
    """Numbers by name of an enum of protocol.h."""
    (body,) = re.findall(rf"enum (?:class )?{name} : uint8_t {{(.*?)}};", HEADER, re.DOTALL)
    return {key: int(number, 0) for key, number in re.findall(r"(\w+) = (\w+)", body)}


@pytest.mark.parametrize(("in_sketch", "in_driver"), ENUMS.items())
def test_every_name_has_one_number(in_sketch: str, in_driver: type[enum.IntEnum | codes.NamedCode]) -> None:
    numbers = enum_of(in_sketch)
    if in_driver is codes.Refusal:
        # NONE marks an accepted request inside the firmware; it is never sent.
        assert numbers.pop("NONE") == 0
    assert numbers == {
        each.name: each.code if isinstance(each, codes.NamedCode) else each.value for each in in_driver
    }


@pytest.mark.parametrize(
    "name",
    [
        "PROTOCOL_VERSION", "CHANNELS", "DUTY_FULL", "CHANNEL_HOMED", "CHANNEL_LIMITED", "CHANNEL_SENSOR_OK",
        "PULSE_MS", "TRACE_MS", "CURRENT_EVERY_MS", "NO_CHANNEL", "HARDWARE_DECODER",
        "CELL_ANALOG", "CELL_CONVERTER",
        "BOARD_CONFIGURED", "BOARD_DEMAND_STALE", "BOARD_POSITION_LOST", "CHANNEL_POSITION_LOST",
    ],
)  # fmt: skip
def test_every_constant_is_the_same(name: str) -> None:
    (number,) = re.findall(rf"const \w+ {name} = (\w+);", HEADER)
    assert getattr(codes, name) == int(number, 0)


def test_the_page_lists_every_message_with_its_number() -> None:
    requests = re.findall(r"^\| ([0-9A-F]{2}) \| (\w+) \|", PAGE, re.MULTILINE)
    answers = re.findall(r"^\*\*(\w+) \(([0-9A-F]{2})\)\*\*", PAGE, re.MULTILINE)
    (refused,) = re.findall(r"\*\*refused \(([0-9A-F]{2})\)\*\*", PAGE)
    page = {name.upper(): int(number, 16) for number, name in requests}
    page |= {{"hello": "HELLO_ANSWER"}.get(name, name.upper()): int(number, 16) for name, number in answers}
    assert page | {"REFUSED": int(refused, 16)} == enum_of("Message")


def test_the_page_lists_every_refusal_and_every_fault() -> None:
    refusals, faults = re.split(r"^\| reason \| of the safe state \|$", PAGE, flags=re.MULTILINE)
    refusals = refusals.split("| reason | | detail |")[1]
    rows = re.compile(r"^\| (\d+) \|", re.MULTILINE)
    for table, name in ((refusals, "Refusal"), (faults, "Reason")):
        assert [int(number) for number in rows.findall(table)] == sorted(set(enum_of(name).values()) - {0})


@pytest.mark.parametrize(
    ("pattern", "name"),
    [
        (r"`rest u8` \((.*?)\)", "Rest"),
        (r"`start u8` \((.*?)\)", "Safe"),
        (r"`bridge u8` \((.*?)\)", "Bridge"),
        (r"Low four bits of `state`: (.*?);", "State"),
        (r"`role u8` \((.*?)\)", "Role"),
        (r"causes: (.*?)\.", "ResetCause"),
    ],
)
def test_the_page_names_every_value(pattern: str, name: str) -> None:
    (values,) = re.findall(pattern, PAGE, re.DOTALL)
    found = {
        key.upper().replace("-", "_"): int(number) for number, key in re.findall(r"(\d+) ([\w-]+)", values)
    }
    assert found == enum_of(name)


@pytest.mark.parametrize(
    ("role", "variable", "bullet", "fields"),
    [
        ("motor", "m", "* motors:", MOTOR_FIELDS),
        ("regulator", "r", "* regulators:", REGULATOR_FIELDS),
    ],
)
def test_configuration_fields_have_one_order(
    role: str, variable: str, bullet: str, fields: dict[str, str]
) -> None:
    head = {"channel": "B", "safe": "B", "start": "B"}
    source = (CORE / "config.cpp").read_text(encoding="utf-8")
    (body,) = re.findall(rf"void read_{role}\(.*?\n}}", source, re.DOTALL)
    read = re.findall(rf"(?:{variable}\.|uint8_t )(\w+) = (?:check\.within\()?in\.(\w+)\(\)", body)
    assert head | {name: STRUCT_CODES[kind] for name, kind in read} == fields
    text = PAGE[PAGE.index(bullet) :].split(";\n" if role == "motor" else ", then `duty")[0]
    listed = re.findall(r"`(\w+) ([ui]\d+)`", text)
    assert head | {name: STRUCT_CODES[kind] for name, kind in listed} == fields
    assert [*head, *(name for name, _ in listed)] == [*head, *(name for name, _ in read)] == list(fields)


def test_fields_of_a_load_cell_have_one_order() -> None:
    source = (CORE / "config.cpp").read_text(encoding="utf-8")
    (body,) = re.findall(r"void read_tension\(.*?\n}", source, re.DOTALL)
    read = re.findall(r"t\.(\w+) = (?:check\.within\()?in\.(\w+)\(\)", body)
    assert {name: STRUCT_CODES[kind] for name, kind in read} == TENSION_FIELDS
    text = PAGE[PAGE.index("* motors with flag 16") : PAGE.index("* regulators:")]
    listed = re.findall(r"`(\w+) ([ui]\d+)`", text)
    assert listed == read == list(zip(TENSION_FIELDS, (kind for _, kind in read), strict=True))
