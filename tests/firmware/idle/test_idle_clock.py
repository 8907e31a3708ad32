"""A board without a host for weeks: its clock of 32 bits is beyond half of its range since then."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from contid.hal import AxisOnBus
from contid_devices.due.firmware_build import WARNINGS, build_once, core_sources, firmware_dir
from contid_drivers.due import frames, messages, wiring
from contid_drivers.due.codes import BoardState, RestCode, Type
from contid_drivers.due.messages import Answer, Refused, Telemetry
from contid_drivers.due.options import DueAxisOptions, DueBusOptions, Role

pytestmark = pytest.mark.process

DAY_MS = 24 * 3600 * 1000


def answers(lines: list[str]) -> list[Answer]:
    """What the board answers to the requests among the lines."""
    flags = ["g++", "-std=gnu++11", *WARNINGS, f"-I{firmware_dir()}"]
    program = build_once("idle", flags, [*core_sources(), Path(__file__).with_name("main.cpp")], [])
    asked = "\n".join(lines)
    found = subprocess.run([program], input=asked, capture_output=True, text=True, check=True).stdout.split()
    return [messages.read_answer(bytes.fromhex(each))[1] for each in found]


def ask(kind: Type, body: bytes) -> str:
    return f"ask {messages.request(kind, 1, body).hex()}"


@pytest.mark.parametrize("days", [1, 24, 25, 40, 49])
def test_demands_and_pulses_are_taken_after_days_of_rest(days: int) -> None:
    axis = AxisOnBus("m0", DueAxisOptions.model_validate({"channel": "m0"}), (-1.0, 60.0))
    blob = wiring.board_config("board", DueBusOptions(port="x", role=Role.MOTOR, watchdog_ms=100), [axis])
    crc, now = frames.crc16(blob), days * DAY_MS
    mask = messages.mask_body(crc, [0])
    asked = [
        f"at {now}", ask(Type.CONFIGURE, wiring.config_body(blob)), ask(Type.ARM, mask),
        f"at {now + 60}", ask(Type.DEMAND, messages.demand(crc, now + 50, {})),
        f"at {now + 120}", ask(Type.DEMAND, messages.demand(crc, now + 110, {})),
        ask(Type.STOP, messages.stop([0], RestCode.RELAX)),
        f"at {now + 130}", ask(Type.PULSE, messages.pulse(crc, now + 125, 0, 1000, 5)),
        ask(Type.PULSE, messages.pulse(crc, now + 125, 0, 1000, 5)),
    ]  # fmt: skip
    *_, fed, _, pulsed, again = answers(asked)
    assert isinstance(fed, Telemetry)
    assert fed.channels[0].state is BoardState.ARMED
    assert isinstance(pulsed, Telemetry), pulsed
    assert isinstance(again, Refused)
