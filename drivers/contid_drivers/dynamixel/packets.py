"""Packets of Dynamixel Protocol 2.0: header, byte stuffing, CRC, and extraction from a stream.

A packet is ``FF FF FD 00 ID LEN_L LEN_H INST PARAM.. CRC_L CRC_H``; a status packet has instruction 0x55 and
its error byte as first parameter. Between instruction and CRC every ``FF FF FD`` is sent as ``FF FF FD FD``,
so the header cannot occur inside a packet. LEN counts from INST to the CRC's end, stuffing included. The CRC
is CRC-16/BUYPASS (polynomial 0x8005, start 0) over everything before it.

The answer to a fast read is one packet to which every servo adds ``ERROR ID DATA CRC``, each CRC over all
bytes before it; its length is fixed in advance, so it has no stuffing. Source: e-manual, Protocol 2.0.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

HEADER: Final = b"\xff\xff\xfd\x00"
BROADCAST: Final = 0xFE
#: Bytes of a status packet around its parameters: header 4, id, length 2, instruction, error, CRC 2.
STATUS_OVERHEAD: Final = 11
ALERT: Final = 0x80
#: Longest LEN accepted; a corrupted length must not make the receiver wait for bytes that never come.
LENGTH_MAX: Final = 4096
_PATTERN, _STUFFED = b"\xff\xff\xfd", b"\xff\xff\xfd\xfd"


class Instruction(IntEnum):
    """Instruction of a packet."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REG_WRITE = 0x04
    ACTION = 0x05
    FACTORY_RESET = 0x06
    REBOOT = 0x08
    CLEAR = 0x10
    STATUS = 0x55
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83
    FAST_SYNC_READ = 0x8A
    BULK_READ = 0x92
    BULK_WRITE = 0x93
    FAST_BULK_READ = 0x9A


class StatusError(IntEnum):
    """Error of a status packet, without its alert bit."""

    NONE = 0
    RESULT_FAIL = 1
    INSTRUCTION = 2
    CRC = 3
    DATA_RANGE = 4
    DATA_LENGTH = 5
    DATA_LIMIT = 6
    ACCESS = 7


STATUS_ERROR_TEXT: Final[dict[int, str]] = {
    1: "could not be processed",
    2: "unknown instruction",
    3: "CRC error",
    4: "value out of range",
    5: "wrong data length",
    6: "value beyond a limit",
    7: "not accessible (read-only, undefined, or EEPROM under torque)",
}


def _crc_table() -> tuple[int, ...]:
    table = []
    for byte in range(256):
        crc = byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ 0x8005 if crc & 0x8000 else crc << 1
        table.append(crc & 0xFFFF)
    return tuple(table)


_CRC: Final = _crc_table()


def crc16(data: Iterable[int], crc: int = 0) -> int:
    """CRC-16/BUYPASS of ``data``, going on from ``crc``."""
    table = _CRC
    for byte in data:
        crc = ((crc << 8) & 0xFF00) ^ table[(crc >> 8) ^ byte]
    return crc


def stuff(body: bytes) -> bytes:
    """Body of a packet (instruction and parameters) with byte stuffing."""
    return body.replace(_PATTERN, _STUFFED)


def unstuff(body: bytes) -> bytes:
    """Inverse of `stuff`."""
    return body.replace(_STUFFED, _PATTERN)


def build(device: int, instruction: int, parameters: bytes = b"") -> bytes:
    """A whole packet."""
    body = stuff(bytes((instruction,)) + parameters)
    length = len(body) + 2
    head = HEADER + bytes((device, length & 0xFF, length >> 8)) + body
    return head + crc16(head).to_bytes(2, "little")


def build_status(device: int, error: int, parameters: bytes = b"") -> bytes:
    """A whole status packet."""
    return build(device, Instruction.STATUS, bytes((error,)) + parameters)


def read_parameters(address: int, size: int) -> bytes:
    """Parameters of READ, and the first four of a sync read."""
    return address.to_bytes(2, "little") + size.to_bytes(2, "little")


def sync_read(address: int, size: int, ids: Sequence[int], fast: bool = False) -> bytes:
    """A packet that reads the same block of several servos."""
    instruction = Instruction.FAST_SYNC_READ if fast else Instruction.SYNC_READ
    return build(BROADCAST, instruction, read_parameters(address, size) + bytes(ids))


def sync_write(address: int, size: int, values: Iterable[tuple[int, bytes]]) -> bytes:
    """A packet that writes the same block of several servos; it gets no answer."""
    block = b"".join(bytes((device,)) + data for device, data in values)
    return build(BROADCAST, Instruction.SYNC_WRITE, read_parameters(address, size) + block)


@dataclass(frozen=True, slots=True)
class Packet:
    """An intact packet; ``parameters`` are un-stuffed and, in a status, start after the error."""

    device: int
    instruction: int
    error: int
    parameters: bytes
    wire: bytes


def take(stream: bytearray, final: bool = False) -> Packet | None:
    """Remove the first intact packet from ``stream`` with everything before it, and return it.

    Args:
        stream: bytes received so far; shortened in place.
        final: no more bytes will come: an incomplete packet is skipped instead of awaited.

    Returns:
        None without a whole packet (yet).
    """
    while True:
        start = stream.find(HEADER)
        if start < 0:
            del stream[: max(0, len(stream) - len(HEADER) + 1)]
            return None
        if start:
            del stream[:start]
        length = stream[5] | stream[6] << 8 if len(stream) >= 7 else 3
        end = 7 + length
        if len(stream) < end and 3 <= length <= LENGTH_MAX:
            if not final:
                return None
        elif 3 <= length <= LENGTH_MAX:
            wire = bytes(stream[:end])
            if crc16(wire[:-2]) == wire[-2] | wire[-1] << 8:
                del stream[:end]
                return _opened(wire)
        # Broken: the next header may lie inside the length this one declared.
        del stream[: len(HEADER)]


def _opened(wire: bytes) -> Packet:
    raw = wire[7:-2]
    if raw[0] != Instruction.STATUS:
        return Packet(wire[4], raw[0], 0, unstuff(raw[1:]), wire)
    body = raw if wire[4] == BROADCAST else unstuff(raw)
    return Packet(wire[4], body[0], body[1] if len(body) > 1 else 0, body[2:], wire)


@dataclass(frozen=True, slots=True)
class Part:
    """One servo's part of the answer to a fast read."""

    device: int
    error: int
    data: bytes


def fast_start(stream: bytes | bytearray, whole: int) -> tuple[int, int]:
    """Start of the answer of ``whole`` bytes to a fast read, and the number of answers of other lengths.

    The start is the length of ``stream`` without one. Skips instructions (an echo) and plain answers.
    """
    head = HEADER + bytes((BROADCAST,))
    late, at = 0, bytes(stream).find(head)
    while at >= 0:
        if len(stream) < at + 8:
            return at, late
        if stream[at + 7] == Instruction.STATUS:
            if stream[at + 5] | stream[at + 6] << 8 == whole - 7:
                return at, late
            late += 1
        at = bytes(stream).find(head, at + 1)
    return len(stream), late


def fast_parts(stream: bytes | bytearray, ids: Sequence[int], sizes: Sequence[int]) -> list[Part]:
    """Intact parts of the answer to a fast read, from its start up to the first damaged one.

    The last CRC covers everything, so a whole answer needs only that one; a shorter one is accepted up to
    the last part whose own CRC is valid.
    """
    start = bytes(stream).find(HEADER + bytes((BROADCAST,)))
    if start < 0 or len(stream) - start < 8 or stream[start + 7] != Instruction.STATUS:
        return []
    data = bytes(stream[start:])
    whole = 8 + sum(sizes) + 4 * len(sizes)
    trusted = len(data) >= whole and crc16(data[: whole - 2]) == data[whole - 2] | data[whole - 1] << 8
    parts: list[Part] = []
    at, crc = 8, 0 if trusted else crc16(data[:8])
    for device, size in zip(ids, sizes, strict=True):
        end = at + size + 4
        if len(data) < end or data[at + 1] != device:
            break
        if not trusted:
            crc = crc16(data[at : end - 2], crc)
            if crc != data[end - 2] | data[end - 1] << 8:
                break
            crc = crc16(data[end - 2 : end], crc)
        parts.append(Part(device, data[at], data[at + 2 : end - 2]))
        at = end
    return parts
