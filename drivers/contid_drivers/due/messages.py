"""Messages of the Due protocol: builders of requests, decoders of answers (firmware/PROTOCOL.md)."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeAlias

from contid.errors import ContidError
from contid.hal.pulses import EncoderAnswer
from contid_drivers.due.codes import (
    BOARD_CONFIGURED,
    BOARD_DEMAND_STALE,
    BOARD_POSITION_LOST,
    BOARD_SUPPLY_LOW,
    CHANNEL_HOMED,
    CHANNEL_LIMITED,
    CHANNEL_POSITION_LOST,
    CHANNEL_SENSOR_OK,
    CHANNELS,
    CURRENT_EVERY_MS,
    NO_CHANNEL,
    NO_TENSION,
    NO_VELOCITY,
    PROTOCOL_VERSION,
    TRACE_MS,
    BoardState,
    Reason,
    Refusal,
    ResetCause,
    RestCode,
    Type,
)
from contid_drivers.due.options import Role


@dataclass(frozen=True, slots=True)
class Hello:
    """Identity and state of a board.

    Attributes:
        build_id: number of the sources it was built from; 0 when it was built by hand.
        unique_id: number of its chip, in hexadecimal.
        boot: starts since power-up.
        boot_id: random, another one at every start.
        position_lost: a motor counts from an unknown position.
        bridges: kinds of H-bridge it can drive, one bit each (`options.Bridge`).
        adc_steps, adc_mv: full scale of an analogue input.
    """

    role: int
    channels: int
    firmware: tuple[int, int, int]
    build_id: int
    unique_id: str
    boot: int
    boot_id: int
    uptime_ms: int
    cause: ResetCause
    configured: bool
    position_lost: bool
    config_crc: int
    capabilities: tuple[int, ...]
    bridges: int
    adc_steps: int
    adc_mv: int
    pins: str

    @property
    def role_name(self) -> str:
        """The role as written in a robot file."""
        roles = list(Role)
        return roles[self.role] if self.role < len(roles) else f"{self.role}?"


@dataclass(frozen=True, slots=True)
class BoardReport:
    """One channel of a telemetry: counts and counts/s, or Pa and Pa/s; ``tension_mn`` of a load cell."""

    state: BoardState
    reason: Reason
    homed: bool
    limited: bool
    sensor_ok: bool
    position_lost: bool
    position: int
    velocity: int
    duty: int
    aux: int
    missed_edges: int
    tension_mn: int | None = None


@dataclass(frozen=True, slots=True)
class Telemetry:
    """State of the board and of its configured channels at one tick.

    Attributes:
        uptime_ms: the tick.
        age_us: time from the tick to this telemetry.
        supply_low: the 3.3 V were too low since the telemetry before.
        trips: channels that the watchdog stopped since the start.
        longest_ms: longest time without feeding the watchdog while a channel was armed.
    """

    uptime_ms: int
    age_us: int
    boot_id: int
    cause: ResetCause
    config_crc: int
    configured: bool
    stale: bool
    supply_low: bool
    bad_frames: int
    dropped: int
    trips: int
    longest_ms: int
    channels: Mapping[int, BoardReport]


@dataclass(frozen=True, slots=True)
class PulseTrace:
    """What one open-loop pulse caused; empty before the first pulse (``channel`` None).

    Attributes:
        start_ms: uptime of the board when the drive began.
        duty: ordered duty, of `codes.DUTY_FULL`.
        ordered_ms, driven_ms: duration ordered, and driven so far.
        encoders: of every channel of the board, to the newest sample; of the edges at a hardware decoder,
            those that samples of 1 ms show.
        faults: numbers of the samples in which the H-bridge reported a fault.
        currents_ma: every second sample, from the first on.
        positions: counts from the start, 1 ms apart, the first 1 ms after the drive began.
    """

    channel: int | None
    start_ms: int = 0
    duty: int = 0
    ordered_ms: int = 0
    driven_ms: int = 0
    encoders: tuple[EncoderAnswer, ...] = ()
    faults: tuple[int, ...] = ()
    currents_ma: tuple[int, ...] = ()
    positions: tuple[int, ...] = ()

    @property
    def complete(self) -> bool:
        """True when the trace is over."""
        return len(self.positions) == TRACE_MS


@dataclass(frozen=True, slots=True)
class Configured:
    """The board accepted a configuration."""

    config_crc: int


@dataclass(frozen=True, slots=True)
class Refused:
    """The board refused a request; ``detail`` depends on the reason."""

    request: int
    refusal: int
    detail: int

    @property
    def message(self) -> str:
        """The reason as text."""
        try:
            name = Refusal(self.refusal).name.lower().replace("_", " ")
        except ValueError:
            name = f"reason {self.refusal}"
        return f"{name} (detail {self.detail})"


Answer: TypeAlias = Hello | Configured | Telemetry | Refused | PulseTrace


class BadAnswerError(ContidError):
    """An answer with a valid CRC that this version cannot decode."""


_HEADER = struct.Struct("<BBB")
_HELLO = struct.Struct("<BBBBBI16sHIIBBH6BBHH")
_TELEMETRY = struct.Struct("<IHIBHBHHHHB")
_REPORT = struct.Struct("<BBiihhB")
_PULSED = struct.Struct("<BIhBBB")
_MOTION = struct.Struct("<hHHB")


def request(kind: Type, sequence: int, body: bytes = b"") -> bytes:
    """The payload of a request."""
    return _HEADER.pack(PROTOCOL_VERSION, kind, sequence) + body


def demand(
    config_crc: int, echo_ms: int, values: Mapping[int, int], velocities: Mapping[int, int] | None = None
) -> bytes:
    """The body of a demand.

    Args:
        config_crc: checksum of the configuration the values are meant for.
        echo_ms: the uptime in the newest telemetry.
        values: counts or Pa by channel.
        velocities: counts/s or Pa/s by channel; a channel left out has none.
    """
    body = struct.pack("<HIB", config_crc, echo_ms, mask_of(values))
    for channel in sorted(values):
        body += struct.pack("<ii", values[channel], (velocities or {}).get(channel, NO_VELOCITY))
    return body


def mask_body(config_crc: int, channels: Iterable[int]) -> bytes:
    """The body of arm, clear and home."""
    return struct.pack("<HB", config_crc, mask_of(channels))


def park(config_crc: int, channels: Iterable[int], parked: bool) -> bytes:
    """The body of a park: the shafts are at ``power_up`` now, or (``parked`` false) somewhere."""
    return mask_body(config_crc, channels) + bytes([parked])


def pulse(config_crc: int, echo_ms: int, channel: int, duty: int, ms: int) -> bytes:
    """The body of a pulse."""
    return struct.pack("<HIBhB", config_crc, echo_ms, channel, duty, ms)


def trace(config_crc: int) -> bytes:
    """The body of a trace."""
    return struct.pack("<H", config_crc)


def stop(channels: Iterable[int], rest: RestCode) -> bytes:
    """The body of a stop."""
    return struct.pack("<BB", mask_of(channels), rest)


def mask_of(channels: Iterable[int]) -> int:
    """A mask with the bit of each of these channels."""
    return sum({1 << channel for channel in channels})


class NumberedAnswer(NamedTuple):
    """An answer, and the sequence number of its request."""

    sequence: int
    answer: Answer


def read_answer(payload: bytes) -> NumberedAnswer:
    """The answer in a payload.

    Raises:
        BadAnswerError: another protocol version, or a length of no answer.
    """
    try:
        version, kind, sequence = _HEADER.unpack_from(payload)
        if version != PROTOCOL_VERSION:
            raise BadAnswerError(f"the board has protocol version {version}, this contid {PROTOCOL_VERSION}")
        return NumberedAnswer(sequence, _read_body(kind, payload[_HEADER.size :]))
    except (struct.error, ValueError, KeyError) as error:
        raise BadAnswerError(f"unreadable answer {payload.hex()}: {error}") from error


def _read_body(kind: int, body: bytes) -> Answer:
    if kind == Type.TELEMETRY:
        return _read_telemetry(body)
    if kind == Type.REFUSED:
        return Refused(*struct.unpack("<BBH", body))
    if kind == Type.PULSED:
        return _read_trace(body)
    if kind == Type.CONFIGURED:
        return Configured(*struct.unpack("<H", body))
    if kind == Type.HELLO_ANSWER:
        fields = _HELLO.unpack_from(body)
        return Hello(
            role=fields[0],
            channels=fields[1],
            firmware=(fields[2], fields[3], fields[4]),
            build_id=fields[5],
            unique_id=fields[6].hex(),
            boot=fields[7],
            boot_id=fields[8],
            uptime_ms=fields[9],
            cause=ResetCause(fields[10]),
            configured=bool(fields[11] & BOARD_CONFIGURED),
            position_lost=bool(fields[11] & BOARD_POSITION_LOST),
            config_crc=fields[12],
            capabilities=tuple(fields[13:19]),
            bridges=fields[19],
            adc_steps=fields[20],
            adc_mv=fields[21],
            pins=body[_HELLO.size :].decode("ascii", "replace"),
        )
    raise BadAnswerError(f"unknown answer {kind:#04x}")


def _read_trace(body: bytes) -> PulseTrace:
    if body[:1] == bytes([NO_CHANNEL]):
        return PulseTrace(channel=None)
    channel, start_ms, duty, ordered_ms, driven_ms, samples = _PULSED.unpack_from(body)
    at = _PULSED.size
    encoders = tuple(
        EncoderAnswer(*_MOTION.unpack_from(body, at + _MOTION.size * i)) for i in range(CHANNELS)
    )
    at += _MOTION.size * CHANNELS
    faults = int.from_bytes(body[at : at + TRACE_MS // 8], "little")
    at += TRACE_MS // 8
    currents = struct.unpack_from(f"<{TRACE_MS // CURRENT_EVERY_MS}h", body, at)
    positions = struct.unpack(f"<{TRACE_MS}h", body[at + 2 * len(currents) :])
    return PulseTrace(
        channel,
        start_ms,
        duty,
        ordered_ms,
        driven_ms,
        encoders,
        tuple(i for i in range(samples) if faults >> i & 1),
        currents[: (samples + CURRENT_EVERY_MS - 1) // CURRENT_EVERY_MS],
        positions[:samples],
    )


def _read_telemetry(body: bytes) -> Telemetry:
    uptime, age, boot_id, cause, crc, flags, bad, dropped, trips, longest, mask = _TELEMETRY.unpack_from(body)
    channels = {}
    at = _TELEMETRY.size
    for channel in range(CHANNELS):
        if not mask & (1 << channel):
            continue
        state, reason, position, velocity, duty, aux, missed = _REPORT.unpack_from(body, at)
        at += _REPORT.size
        channels[channel] = BoardReport(
            BoardState(state & 0x0F),
            Reason(reason),
            bool(state & CHANNEL_HOMED),
            bool(state & CHANNEL_LIMITED),
            bool(state & CHANNEL_SENSOR_OK),
            bool(state & CHANNEL_POSITION_LOST),
            position,
            velocity,
            duty,
            aux,
            missed,
        )
    # Behind the channels: the tensions of those with a load cell.
    cells = body[at] if at < len(body) else 0
    at += at < len(body)
    for channel in (each for each in range(CHANNELS) if cells & (1 << each)):
        (tension,) = struct.unpack_from("<i", body, at)
        at += 4
        channels[channel] = replace(channels[channel], tension_mn=None if tension == NO_TENSION else tension)
    if at != len(body):
        raise BadAnswerError(f"telemetry of {len(body)} bytes, expected {at}")
    return Telemetry(
        uptime_ms=uptime,
        age_us=age,
        boot_id=boot_id,
        cause=ResetCause(cause),
        config_crc=crc,
        configured=bool(flags & BOARD_CONFIGURED),
        stale=bool(flags & BOARD_DEMAND_STALE),
        supply_low=bool(flags & BOARD_SUPPLY_LOW),
        bad_frames=bad,
        dropped=dropped,
        trips=trips,
        longest_ms=longest,
        channels=channels,
    )
