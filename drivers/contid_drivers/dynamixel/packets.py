"""Packets of Dynamixel Protocol 2.0: header, byte stuffing, CRC, and extraction from a stream.

A packet is ``FF FF FD 00 ID LEN_L LEN_H INST PARAM.. CRC_L CRC_H``; a status packet has instruction 0x55 and
its error byte as first parameter. Between instruction and CRC every ``FF FF FD`` is sent as ``FF FF FD FD``,
so the header cannot occur inside a packet. LEN counts from INST to the CRC's end, stuffing included. The CRC
is CRC-16/BUYPASS (polynomial 0x8005, start 0) over everything before it.

Source: e-manual, Protocol 2.0. The answer to a fast read is in `fast_answer`.
"""

from __future__ import annotations

import struct
from array import array
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import cache
from typing import Final, NamedTuple

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


@cache
def _crc_of_pairs() -> array[int]:
    """CRC of two bytes by their value: half the steps of a table of bytes; made when needed (10 ms)."""
    # An array stays in a processor's cache.
    return array(
        "H", (((first << 8) & 0xFF00) ^ _CRC[(first >> 8) ^ byte] for first in _CRC for byte in range(256))
    )


@cache
def _pairs(count: int) -> Callable[[bytes | bytearray | memoryview], tuple[int, ...]]:
    return struct.Struct(f">{count}H").unpack


def crc16(data: bytes | bytearray | memoryview, crc: int = 0) -> int:
    """CRC-16/BUYPASS of ``data``, going on from ``crc``."""
    table = _crc_of_pairs()
    if len(data) & 1:
        crc = ((crc << 8) & 0xFF00) ^ _CRC[(crc >> 8) ^ data[0]]
        data = data[1:]
    for pair in _pairs(len(data) >> 1)(data):
        crc = table[crc ^ pair]
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


#: Bytes of a status packet before its error.
STATUS_HEAD: Final = 8


def status_head(device: int, size: int) -> bytes:
    """First bytes of a status with ``size`` parameters and no stuffing."""
    return HEADER + bytes((device, (size + 4) & 0xFF, (size + 4) >> 8, Instruction.STATUS))


class Status(NamedTuple):
    """What a servo answered."""

    error: int
    parameters: bytes


def take_status(stream: bytearray, size: int) -> Status | None:
    """Remove the status packet at the start of ``stream``; a quick `take` for the usual case.

    Args:
        stream: begins with a `status_head` of this ``size``; shortened in place.
        size: number of parameters.

    Returns:
        None if it is incomplete, broken or stuffed, which `take` decides.
    """
    end = STATUS_HEAD + size + 1
    if len(stream) < end + 2:
        return None
    wire = bytes(stream[:end])
    # With stuffing the same length holds fewer parameters.
    if _PATTERN in wire[7:] or crc16(wire) != stream[end] | stream[end + 1] << 8:
        return None
    del stream[: end + 2]
    return Status(wire[STATUS_HEAD], wire[STATUS_HEAD + 1 :])


def _opened(wire: bytes) -> Packet:
    raw = wire[7:-2]
    if raw[0] != Instruction.STATUS:
        return Packet(wire[4], raw[0], 0, unstuff(raw[1:]), wire)
    body = raw if wire[4] == BROADCAST else unstuff(raw)
    return Packet(wire[4], body[0], body[1] if len(body) > 1 else 0, body[2:], wire)
