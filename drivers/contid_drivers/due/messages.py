"""Messages of the Due protocol as values: builders of requests, readers of answers (firmware/PROTOCOL.md)."""

from __future__ import annotations

import enum
import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final, TypeAlias

from contid.errors import ContidError

PROTOCOL_VERSION: Final = 1
CHANNELS: Final = 6
#: Full duty in either direction.
DUTY_FULL: Final = 32767
#: Steps of the board's analogue inputs over 3.3 V.
ADC_STEPS: Final = 4095
ADC_MV: Final = 3300.0


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


class State(enum.IntEnum):
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
    def words(self) -> str:
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
    def words(self) -> str:
        """The cause for people."""
        return self.name.lower().replace("_", "-")


@dataclass(frozen=True, slots=True)
class Hello:
    """What a board says of itself."""

    role: int
    channels: int
    firmware: tuple[int, int, int]
    boot: int
    uptime_ms: int
    cause: ResetCause
    configured: bool
    config_crc: int
    capabilities: tuple[int, ...]
    pins: str

    @property
    def role_name(self) -> str:
        """The role as the robot file writes it."""
        return {0: "motor", 1: "pressure"}.get(self.role, f"{self.role}?")


@dataclass(frozen=True, slots=True)
class Report:
    """One channel in a telemetry: counts and counts/s, or Pa and Pa/s."""

    state: State
    reason: Reason
    homed: bool
    limited: bool
    sensor_ok: bool
    position: int
    velocity: int
    duty: int
    aux: int


@dataclass(frozen=True, slots=True)
class Telemetry:
    """The answer to every demand."""

    uptime_ms: int
    boot: int
    cause: ResetCause
    config_crc: int
    configured: bool
    stale: bool
    bad_frames: int
    dropped: int
    channels: Mapping[int, Report]


@dataclass(frozen=True, slots=True)
class Configured:
    """The board took a configuration."""

    config_crc: int


@dataclass(frozen=True, slots=True)
class Refused:
    """The board did not do what it was asked; ``detail`` depends on the reason."""

    request: int
    refusal: int
    detail: int

    @property
    def words(self) -> str:
        """The reason for people."""
        try:
            name = Refusal(self.refusal).name.lower().replace("_", " ")
        except ValueError:
            name = f"reason {self.refusal}"
        return f"{name} (detail {self.detail})"


Answer: TypeAlias = Hello | Configured | Telemetry | Refused


class BadAnswerError(ContidError):
    """An answer with a good CRC that this version cannot read."""


_HEADER = struct.Struct("<BBB")
_HELLO = struct.Struct("<BBBBBHIBBH6B")
_TELEMETRY = struct.Struct("<IHBHBHHB")
_REPORT = struct.Struct("<BBiihh")


def request(kind: Type, sequence: int, body: bytes = b"") -> bytes:
    """The payload of a request."""
    return _HEADER.pack(PROTOCOL_VERSION, kind, sequence) + body


def demand(config_crc: int, heard_ms: int, values: Mapping[int, int]) -> bytes:
    """The body of a demand: channel -> counts or Pa. ``heard_ms`` is the uptime in the newest telemetry."""
    channels = sorted(values)
    body = struct.pack("<HIB", config_crc, heard_ms, mask_of(channels))
    return body + struct.pack(f"<{len(channels)}i", *(values[channel] for channel in channels))


def masked(config_crc: int, channels: Iterable[int]) -> bytes:
    """The body of arm, clear and home."""
    return struct.pack("<HB", config_crc, mask_of(channels))


def stop(channels: Iterable[int], rest: RestCode) -> bytes:
    """The body of a stop."""
    return struct.pack("<BB", mask_of(channels), rest)


def mask_of(channels: Iterable[int]) -> int:
    """One bit per channel."""
    return sum({1 << channel for channel in channels})


def read_answer(payload: bytes) -> tuple[int, Answer]:
    """A payload -> its sequence number and the answer.

    Raises:
        BadAnswerError: another protocol version, or a length that fits no answer.
    """
    try:
        version, kind, sequence = _HEADER.unpack_from(payload)
        if version != PROTOCOL_VERSION:
            raise BadAnswerError(
                f"the board speaks protocol version {version}, this contid speaks {PROTOCOL_VERSION}"
            )
        return sequence, _read_body(kind, payload[_HEADER.size :])
    except (struct.error, ValueError) as error:
        raise BadAnswerError(f"unreadable answer {payload.hex()}: {error}") from error


def _read_body(kind: int, body: bytes) -> Answer:
    if kind == Type.TELEMETRY:
        return _read_telemetry(body)
    if kind == Type.REFUSED:
        return Refused(*struct.unpack("<BBH", body))
    if kind == Type.CONFIGURED:
        return Configured(*struct.unpack("<H", body))
    if kind == Type.HELLO_ANSWER:
        fields = _HELLO.unpack_from(body)
        return Hello(
            role=fields[0],
            channels=fields[1],
            firmware=(fields[2], fields[3], fields[4]),
            boot=fields[5],
            uptime_ms=fields[6],
            cause=ResetCause(fields[7]),
            configured=bool(fields[8] & 1),
            config_crc=fields[9],
            capabilities=tuple(fields[10:16]),
            pins=body[_HELLO.size :].decode("ascii", "replace"),
        )
    raise BadAnswerError(f"unknown answer {kind:#04x}")


def _read_telemetry(body: bytes) -> Telemetry:
    uptime, boot, cause, crc, flags, bad, dropped, mask = _TELEMETRY.unpack_from(body)
    channels = {}
    at = _TELEMETRY.size
    for channel in range(CHANNELS):
        if not mask & (1 << channel):
            continue
        state, reason, position, velocity, duty, aux = _REPORT.unpack_from(body, at)
        at += _REPORT.size
        channels[channel] = Report(
            State(state & 0x0F),
            Reason(reason),
            bool(state & 0x10),
            bool(state & 0x20),
            bool(state & 0x40),
            position,
            velocity,
            duty,
            aux,
        )
    if at != len(body):
        raise BadAnswerError(f"telemetry of {len(body)} bytes, expected {at}")
    return Telemetry(
        uptime, boot, ResetCause(cause), crc, bool(flags & 1), bool(flags & 2), bad, dropped, channels
    )
