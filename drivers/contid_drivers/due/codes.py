"""Numbers of the Due protocol by name; a test compares them with protocol.h, which is the reference."""

from __future__ import annotations

import enum
from typing import Final, Self

PROTOCOL_VERSION: Final = 6
CHANNELS: Final = 6
#: Velocity of a demand whose host does not know it.
NO_VELOCITY: Final = -(2**31)
#: Duty at full scale, either direction.
DUTY_FULL: Final = 32767
#: Steps of an analogue input over its 3.3 V.
ADC_STEPS: Final = 4095
ADC_MV: Final = 3300.0
#: Bounds of an open-loop pulse, and the length of its trace.
PULSE_DUTY: Final = DUTY_FULL // 5
PULSE_MS: Final = 30
TRACE_MS: Final = 96
CURRENT_EVERY_MS: Final = 2
NO_CHANNEL: Final = 0xFF
#: Bits next to the state of a channel in telemetry.
CHANNEL_HOMED: Final = 0x10
CHANNEL_LIMITED: Final = 0x20
CHANNEL_SENSOR_OK: Final = 0x40
CHANNEL_POSITION_LOST: Final = 0x80
#: Bits of a channel's capabilities in hello.
HARDWARE_DECODER: Final = 1
CURRENT_SENSE: Final = 4
VALVE_PAIR: Final = 32
CELL_ANALOG: Final = 64
CELL_CONVERTER: Final = 128
#: Tension of a cell that shows none [mN].
NO_TENSION: Final = -(2**31)
#: Ports of a board by number; one at a time commands it.
PORTS: Final = ("native", "programming")
#: Flags of the board.
BOARD_CONFIGURED: Final = 0x01
BOARD_DEMAND_STALE: Final = 0x02
BOARD_POSITION_LOST: Final = 0x04
BOARD_SUPPLY_LOW: Final = 0x08


class Type(enum.IntEnum):
    """Message type: the byte after the version."""

    HELLO = 0x01
    CONFIGURE = 0x02
    ARM = 0x03
    DEMAND = 0x04
    CLEAR = 0x05
    STOP = 0x06
    HOME = 0x07
    PARK = 0x08
    PULSE = 0x09
    TRACE = 0x0A
    HELLO_ANSWER = 0x81
    CONFIGURED = 0x82
    TELEMETRY = 0x84
    PULSED = 0x8A
    REFUSED = 0xFF


class BoardState(enum.IntEnum):
    """State of a channel."""

    OFF = 0
    READY = 1
    ARMED = 2
    HOMING = 3
    STOPPED = 4
    SAFE = 5
    PULSING = 6


class Reason(enum.IntEnum):
    """Fault that put a channel into its safe state, with its text."""

    message: str

    def __new__(cls, number: int, message: str = "") -> Self:
        """A member with its number and text."""
        reason = int.__new__(cls, number)
        reason._value_, reason.message = number, message
        return reason

    NONE = 0
    WATCHDOG = 1, "watchdog: no valid demand in time"
    STALLED = 2, "stalled: driven, but the shaft does not turn"
    ENCODER_SILENT = 3, "encoder silent: driven without stall current, but no counts"
    ENCODER_REVERSED = 4, "runs away from its set-point: encoder or motor reversed"
    FOLLOWING = 5, "following error too large"
    HOME_FAILED = 6, "homing did not find the end stop"
    SENSOR_WIRE = 7, "pressure signal out of range: broken wire"
    LEAK = 8, "pressure stays below its set-point: leak, no supply or no signal"
    OVER_PRESSURE = 9, "pressure above the ceiling"
    BRIDGE = 10, "the H-bridge reports a fault (heat, current or supply)"
    ABOVE_SET_POINT = 11, "pressure stays above its set-point: exhaust blocked, or the read-back is wrong"
    NOT_VENTING = 12, "pressure does not fall at rest: exhaust blocked, or the read-back is wrong"
    ENCODER_EDGES = 13, "encoder edges missed: noise, a loose wire, or too fast; the position is lost"
    HOME_TWICE = 14, "homing stood still at two places: an obstacle, or a shaft or an encoder that slips"
    HOME_MOVED = 15, "its end stop is elsewhere than it was: an obstacle, or the zero moved"
    ENCODER_TRACK = 16, "counts go to and fro while it is driven: one track of its encoder is open"
    READ_BACK = (
        17,
        "pressure reading stands still while the set-point moves: read-back frozen, or valve stuck",
    )
    CELL = 18, "load cell without a reading, or out of its range: open wire, no supply, saturated or reversed"
    CELL_FROZEN = 19, "readings of its load cell are alike to the last bit while the shaft moves"
    CELL_OTHER = 20, "its tendon moves the tension at another axis's load cell, not at its own: swapped cells"
    SLACK = 21, "slack: the tension stays below half of floor_n"
    SNAP = 22, "the tension fell to nothing within milliseconds: the tendon snapped or slipped off"
    OVER_TENSION = 23, "tension above ceiling_n"


class Refusal(enum.IntEnum):
    """Why the board refused a request."""

    UNKNOWN_MESSAGE = 1
    WRONG_VERSION = 2
    WRONG_LENGTH = 3
    WRONG_CRC = 4
    NOT_CONFIGURED = 5
    BAD_CHANNEL = 6
    BAD_VALUE = 7
    SAFE_IS_NOT_START = 8
    WRONG_ROLE = 9
    ARMED_NOW = 10
    LATCHED = 11
    NOT_HOMED = 12
    NO_SENSOR = 13
    NO_HOMING = 14
    PERSISTS = 15
    POSITION_LOST = 16
    OTHER_PORT = 17
    STALE = 18


class NamedCode(enum.StrEnum):
    """Base of names of a robot file whose order is that of their numbers on the wire, from 0."""

    @property
    def code(self) -> int:
        """The number on the wire."""
        return list(type(self)).index(self)


class RestCode(enum.IntEnum):
    """Rest requested by a stop."""

    HOLD = 0
    RELAX = 1
    VENT = 2


class ResetCause(enum.IntEnum):
    """Cause of the board's last start."""

    POWER_UP = 0
    BACKUP = 1
    WATCHDOG = 2
    SOFTWARE = 3
    PIN = 4
    BROWN_OUT = 5

    @property
    def message(self) -> str:
        """The cause as text."""
        return self.name.lower().replace("_", "-")
