"""Numbers of the Due protocol by name, as in firmware/contid_due/src/core/protocol.h: a test compares."""

from __future__ import annotations

import enum
from typing import Final

PROTOCOL_VERSION: Final = 1
CHANNELS: Final = 6
#: Full duty in either direction.
DUTY_FULL: Final = 32767
#: Steps of the board's analogue inputs over 3.3 V.
ADC_STEPS: Final = 4095
ADC_MV: Final = 3300.0
#: Bits beside the state of a channel in telemetry.
CHANNEL_HOMED: Final = 0x10
CHANNEL_LIMITED: Final = 0x20
CHANNEL_SENSOR_OK: Final = 0x40
#: Flags of the board.
BOARD_CONFIGURED: Final = 0x01
BOARD_DEMAND_STALE: Final = 0x02


class Type(enum.IntEnum):
    """First byte after the version."""

    HELLO = 0x01
    CONFIGURE = 0x02
    ARM = 0x03
    DEMAND = 0x04
    CLEAR = 0x05
    STOP = 0x06
    HOME = 0x07
    HELLO_ANSWER = 0x81
    CONFIGURED = 0x82
    TELEMETRY = 0x84
    REFUSED = 0xFF


class BoardState(enum.IntEnum):
    """State of a channel."""

    OFF = 0
    READY = 1
    ARMED = 2
    HOMING = 3
    STOPPED = 4
    SAFE = 5


class Reason(enum.IntEnum):
    """Why a channel is in its safe state: the fault's number."""

    NONE = 0
    DEAD_MAN = 1
    STALLED = 2
    ENCODER_SILENT = 3
    ENCODER_REVERSED = 4
    FOLLOWING = 5
    HOME_FAILED = 6
    SENSOR_WIRE = 7
    LEAK = 8
    OVER_PRESSURE = 9
    BRIDGE = 10

    @property
    def message(self) -> str:
        """The fault for people."""
        return _REASON_WORDS[self]


_REASON_WORDS: Final = {
    Reason.NONE: "",
    Reason.DEAD_MAN: "dead-man: no valid demand in time",
    Reason.STALLED: "stalled: driven, but the shaft does not turn",
    Reason.ENCODER_SILENT: "encoder silent: driven without stall current, but nothing is counted",
    Reason.ENCODER_REVERSED: "runs away from its set-point: encoder or motor reversed",
    Reason.FOLLOWING: "too far behind its set-point",
    Reason.HOME_FAILED: "homing did not find the end stop",
    Reason.SENSOR_WIRE: "pressure signal out of range: broken wire",
    Reason.LEAK: "pressure stays below its set-point: leak, no supply or no signal",
    Reason.OVER_PRESSURE: "pressure above the ceiling",
    Reason.BRIDGE: "the H-bridge reports a fault of its own (heat, current or supply)",
}


class Refusal(enum.IntEnum):
    """Why the board did not do what it was asked."""

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


class RoleCode(enum.IntEnum):
    """What a board is built to drive."""

    MOTOR = 0
    PRESSURE = 1


class SafeCode(enum.IntEnum):
    """What a channel does in its safe state."""

    BRAKE = 0
    COAST = 1
    HOLD = 2
    VENT = 3
    CLOSE = 4


class RestCode(enum.IntEnum):
    """What a stop asks for."""

    HOLD = 0
    RELAX = 1
    VENT = 2


class ResetCause(enum.IntEnum):
    """What started the board."""

    POWER_UP = 0
    BACKUP = 1
    WATCHDOG = 2
    SOFTWARE = 3
    PIN = 4
    BROWN_OUT = 5

    @property
    def message(self) -> str:
        """The cause for people."""
        return self.name.lower().replace("_", "-")
