"""Control table of the XL330: address, size, default, range and unit of every register.

Addresses below 64 are EEPROM, which survives power-off and is locked while torque is on. Goal Current counts
1 mA on this model, although one include of the manual differs. Source: e-manual of the XL330-M288-T.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

TICKS_PER_REV: Final = 4096
RAD_PER_TICK: Final = 2.0 * math.pi / TICKS_PER_REV
TICKS_PER_DEG: Final = TICKS_PER_REV / 360.0
#: Present and Goal Velocity, Profile Velocity: 0.229 rev/min.
RAD_S_PER_UNIT: Final = 0.229 * 2.0 * math.pi / 60.0
DEG_S_PER_UNIT: Final = 0.229 * 360.0 / 60.0
#: Profile Acceleration: 214.577 rev/min^2.
DEG_S2_PER_UNIT: Final = 214.577 * 360.0 / 3600.0
WATCHDOG_MS_PER_UNIT: Final = 20
EEPROM_END: Final = 64


@dataclass(frozen=True, slots=True)
class Register:
    """One item of the control table.

    Attributes:
        address, size: position and width in bytes (little endian).
        default: value of a new servo (EEPROM) or after a reboot (RAM).
        low, high: range of writes; the range of the width where the manual gives none.
        signed: two's complement.
        writable: False for registers only the servo writes.
        unit: unit of one count.
    """

    name: str
    address: int
    size: int
    default: int
    low: int
    high: int
    signed: bool
    writable: bool
    unit: str

    @property
    def eeprom(self) -> bool:
        """Kept at power-off, locked under torque."""
        return self.address < EEPROM_END

    def encode(self, value: int) -> bytes:
        """Bytes on the wire."""
        return (value & ((1 << (8 * self.size)) - 1)).to_bytes(self.size, "little")

    def decode(self, data: bytes | bytearray | memoryview) -> int:
        """Value of bytes from the wire."""
        return int.from_bytes(data, "little", signed=self.signed)


def _rw(name: str, address: int, size: int, default: int, low: int, high: int, *, unit: str = "") -> Register:
    return Register(name, address, size, default, low, high, low < 0, True, unit)


def _ro(name: str, address: int, size: int, default: int, unit: str = "", signed: bool = False) -> Register:
    return Register(name, address, size, default, 0, 0, signed, False, unit)


#: Extended position mode: 256 turns without the last tick (e-manual, register 116).
TURNS = 256 * TICKS_PER_REV - 1

MODEL_NUMBER = _ro("model number", 0, 2, 1200)
FIRMWARE = _ro("firmware version", 6, 1, 52)
ID = _rw("id", 7, 1, 1, 0, 252)
BAUD = _rw("baud rate", 8, 1, 1, 0, 6)
RETURN_DELAY = _rw("return delay time", 9, 1, 250, 0, 254, unit="2 us")
DRIVE_MODE = _rw("drive mode", 10, 1, 0, 0, 13)
OPERATING_MODE = _rw("operating mode", 11, 1, 3, 0, 16)
SECONDARY_ID = _rw("secondary id", 12, 1, 255, 0, 255)
HOMING_OFFSET = _rw("homing offset", 20, 4, 0, -1044479, 1044479, unit="tick")
TEMPERATURE_LIMIT = _rw("temperature limit", 31, 1, 70, 0, 100, unit="deg C")
MAX_VOLTAGE = _rw("max voltage limit", 32, 2, 70, 31, 70, unit="0.1 V")
MIN_VOLTAGE = _rw("min voltage limit", 34, 2, 35, 31, 70, unit="0.1 V")
PWM_LIMIT = _rw("pwm limit", 36, 2, 885, 0, 885, unit="0.113 %")
CURRENT_LIMIT = _rw("current limit", 38, 2, 1750, 0, 1750, unit="mA")
VELOCITY_LIMIT = _rw("velocity limit", 44, 4, 445, 0, 2047, unit="0.229 rpm")
MAX_POSITION = _rw("max position limit", 48, 4, 4095, 0, 4095, unit="tick")
MIN_POSITION = _rw("min position limit", 52, 4, 0, 0, 4095, unit="tick")
STARTUP = _rw("startup configuration", 60, 1, 0, 0, 3)
SHUTDOWN = _rw("shutdown", 63, 1, 0x35, 0, 0x35)
TORQUE_ENABLE = _rw("torque enable", 64, 1, 0, 0, 1)
LED = _rw("led", 65, 1, 0, 0, 1)
STATUS_RETURN_LEVEL = _rw("status return level", 68, 1, 2, 0, 2)
REGISTERED = _ro("registered instruction", 69, 1, 0)
HARDWARE_ERROR = _ro("hardware error status", 70, 1, 0)
VELOCITY_I = _rw("velocity i gain", 76, 2, 1600, 0, 16383)
VELOCITY_P = _rw("velocity p gain", 78, 2, 180, 0, 16383)
POSITION_D = _rw("position d gain", 80, 2, 0, 0, 16383)
POSITION_I = _rw("position i gain", 82, 2, 0, 0, 16383)
POSITION_P = _rw("position p gain", 84, 2, 400, 0, 16383)
#: Gains whose defaults differ between models, in the order of `models.Gains`.
GAINS: Final = (VELOCITY_I, VELOCITY_P, POSITION_D, POSITION_I, POSITION_P)
BUS_WATCHDOG = _rw("bus watchdog", 98, 1, 0, -1, 127, unit="20 ms")
GOAL_PWM = _rw("goal pwm", 100, 2, 885, -885, 885, unit="0.113 %")
GOAL_CURRENT = _rw("goal current", 102, 2, 1750, -1750, 1750, unit="mA")
GOAL_VELOCITY = _rw("goal velocity", 104, 4, 0, -2047, 2047, unit="0.229 rpm")
PROFILE_ACCELERATION = _rw("profile acceleration", 108, 4, 0, 0, 32767, unit="214.577 rev/min2")
PROFILE_VELOCITY = _rw("profile velocity", 112, 4, 0, 0, 32767, unit="0.229 rpm")
GOAL_POSITION = _rw("goal position", 116, 4, 0, -TURNS, TURNS, unit="tick")
REALTIME_TICK = _ro("realtime tick", 120, 2, 0, "ms")
REALTIME_TICKS: Final = 32768
MOVING = _ro("moving", 122, 1, 0)
PRESENT_CURRENT = _ro("present current", 126, 2, 0, "mA", signed=True)
PRESENT_VELOCITY = _ro("present velocity", 128, 4, 0, "0.229 rpm", signed=True)
PRESENT_POSITION = _ro("present position", 132, 4, 0, "tick", signed=True)
PRESENT_VOLTAGE = _ro("present input voltage", 144, 2, 50, "0.1 V")
PRESENT_TEMPERATURE = _ro("present temperature", 146, 1, 25, "deg C")

#: Indirect addressing: entry i (2 bytes at 168 + 2 i) names the register byte that 208 + i stands for.
INDIRECT_COUNT: Final = 20
INDIRECT_ADDRESS: Final = 168
INDIRECT_DATA: Final = 208
INDIRECT_LOW: Final = 64
INDIRECT_HIGH: Final = 227


def _indirect(data: int, count: int, high: int) -> list[Register]:
    """Indirect addresses, from `INDIRECT_LOW` to ``high``, and the data from address ``data`` on."""
    addresses = range(INDIRECT_ADDRESS, INDIRECT_ADDRESS + 2 * count, 2)
    return [
        *(
            _rw(f"indirect address {i + 1}", at, 2, data + i, INDIRECT_LOW, high)
            for i, at in enumerate(addresses)
        ),
        *(_rw(f"indirect data {i + 1}", data + i, 1, 0, 0, 255) for i in range(count)),
    ]


#: Registers of an XL330 with firmware up to 52; `table_of` gives those of the others.
TABLE: Final[tuple[Register, ...]] = (
    MODEL_NUMBER,
    _ro("model information", 2, 4, 0),
    FIRMWARE, ID, BAUD, RETURN_DELAY, DRIVE_MODE, OPERATING_MODE,
    SECONDARY_ID,
    _rw("protocol type", 13, 1, 2, 2, 22),
    HOMING_OFFSET,
    _rw("moving threshold", 24, 4, 10, 0, 1023, unit="0.229 rpm"),
    TEMPERATURE_LIMIT,
    MAX_VOLTAGE, MIN_VOLTAGE,
    PWM_LIMIT,
    CURRENT_LIMIT, VELOCITY_LIMIT, MAX_POSITION, MIN_POSITION,
    STARTUP,
    _rw("pwm slope", 62, 1, 140, 1, 255, unit="1.977 mV/ms"),
    SHUTDOWN, TORQUE_ENABLE,
    LED,
    STATUS_RETURN_LEVEL, REGISTERED, HARDWARE_ERROR,
    VELOCITY_I,
    VELOCITY_P, POSITION_D, POSITION_I, POSITION_P,
    _rw("feedforward 2nd gain", 88, 2, 0, 0, 16383),
    _rw("feedforward 1st gain", 90, 2, 0, 0, 16383),
    BUS_WATCHDOG, GOAL_PWM, GOAL_CURRENT, GOAL_VELOCITY,
    PROFILE_ACCELERATION, PROFILE_VELOCITY, GOAL_POSITION,
    REALTIME_TICK, MOVING,
    _ro("moving status", 123, 1, 0),
    _ro("present pwm", 124, 2, 0, "0.113 %", signed=True),
    PRESENT_CURRENT, PRESENT_VELOCITY, PRESENT_POSITION,
    _ro("velocity trajectory", 136, 4, 0, "0.229 rpm", signed=True),
    _ro("position trajectory", 140, 4, 0, "tick", signed=True),
    PRESENT_VOLTAGE, PRESENT_TEMPERATURE,
    _ro("backup ready", 147, 1, 1),
    *_indirect(INDIRECT_DATA, INDIRECT_COUNT, INDIRECT_HIGH),
)  # fmt: skip


def table_of(indirect_data: int, current_limit: int, gains: Sequence[int]) -> tuple[Register, ...]:
    """The control table of another model.

    Args:
        indirect_data: address of its first indirect data; 224 has 28 of them.
        current_limit: its greatest Current Limit [units]; 0 without current registers.
        gains: defaults of `GAINS`.
    """
    defaults, limits = dict(zip(GAINS, gains, strict=True)), {CURRENT_LIMIT: 0, GOAL_CURRENT: -current_limit}
    table = []
    for register in TABLE:
        if register in defaults:
            table.append(replace(register, default=defaults[register]))
        elif register in limits and current_limit:
            low = limits[register]
            table.append(replace(register, default=current_limit, low=low, high=current_limit))
        elif register not in limits and register.address < INDIRECT_ADDRESS:
            table.append(register)
    count, high = (INDIRECT_COUNT, INDIRECT_HIGH) if indirect_data == INDIRECT_DATA else (28, 661)
    return (*table, *_indirect(indirect_data, count, high))


BAUD_CODES: Final[dict[int, int]] = {
    0: 9600, 1: 57600, 2: 115200, 3: 1000000, 4: 2000000, 5: 3000000, 6: 4000000,
}  # fmt: skip
MODE_NUMBERS: Final[dict[str, int]] = {"extended_position": 4, "current_based_position": 5}
MODE_NAMES: Final[dict[int, str]] = {
    0: "current", 1: "velocity", 3: "position", 4: "extended position", 5: "current-based position",
    16: "PWM",
}  # fmt: skip
#: Fast Sync Read answers from this firmware on; older ones stay silent.
FAST_READ_FIRMWARE: Final = 46


class HardwareError(NamedTuple):
    """One bit of the Hardware Error Status, and what a person does about it."""

    name: str
    remedy: str


#: e-manual of the X series, Hardware Error Status (70) and Shutdown (63).
HARDWARE_ERRORS: Final[dict[int, HardwareError]] = {
    0x01: HardwareError(
        "input voltage out of its limits",
        "measure the supply at its plug: a weak supply, a long chain, or the wrong voltage",
    ),
    0x04: HardwareError(
        "overheated", "let it cool for 20 minutes, then lower its permanent load (current_limit_ma)"
    ),
    0x08: HardwareError(
        "encoder fault", "its encoder does not work: switch its power off and on, else replace the servo"
    ),
    0x10: HardwareError(
        "electrical shock or too little power",
        "look for a short circuit and for wires that are too thin for its current",
    ),
    0x20: HardwareError("overload", "remove what blocks its shaft, or lower its load"),
}
WATCHDOG_TRIPPED: Final = 0xFF


def describe_hardware_error(bits: int) -> str:
    """Hardware Error Status (register 70) as text, "" for none."""
    names = [error.name for bit, error in HARDWARE_ERRORS.items() if bits & bit]
    if unknown := bits & ~sum(HARDWARE_ERRORS):
        names.append(f"unknown bits 0x{unknown:02x}")
    return ", ".join(names)


def remedy_of_hardware_error(bits: int) -> str:
    """What a person does about a Hardware Error Status, "" for none."""
    remedies = [error.remedy for bit, error in HARDWARE_ERRORS.items() if bits & bit]
    if bits and not remedies:
        remedies = ["DYNAMIXEL Wizard may know this error"]
    return "; ".join(remedies)
