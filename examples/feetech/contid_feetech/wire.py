"""Packets of Feetech's protocol: ``FF FF ID LENGTH INSTRUCTION DATA.. CHECKSUM``.

Answers have an error byte in the place of the instruction. Numbers are little-endian in STS and SMS servos,
big-endian in SCS servos; a sign is bit 15 beside a magnitude.
Source: FT-SCS protocol manual; registers: FT-SMS-STS and FT-SCSCL manuals; the vendor's Python SDK.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, NamedTuple

READ, WRITE, SYNC_READ, SYNC_WRITE = 0x02, 0x03, 0x82, 0x83
BROADCAST: Final = 0xFE
#: Bits of the error byte of an answer; the vendor names no others.
ERRORS: Final = {0: "voltage", 1: "angle sensor", 2: "overheating", 3: "overcurrent", 5: "overload"}


class Answer(NamedTuple):
    """The id of a servo, its error byte and its data."""

    device: int
    error: int
    data: bytes


def packet(device: int, code: int, data: bytes) -> bytes:
    """A packet with its checksum; ``code`` is an instruction, or the error byte of an answer."""
    body = bytes([device, len(data) + 2, code]) + data
    return b"\xff\xff" + body + bytes([~sum(body) & 0xFF])


def take(stream: bytearray) -> Iterator[Answer]:
    """Take whole, intact packets off a stream; skips damage byte by byte."""
    while (start := stream.find(b"\xff\xff")) >= 0:
        del stream[:start]
        size = stream[3] + 4 if len(stream) > 3 else 6
        if stream[2:3] != b"\xff" and len(stream) < size:
            return
        body = bytes(stream[2 : size - 1])
        if size >= 6 and body[0] != 0xFF and stream[size - 1] == ~sum(body) & 0xFF:
            yield Answer(body[0], body[2], body[3:])
            del stream[:size]
        else:
            del stream[:1]


def signed(word: int) -> int:
    """The number in a word of magnitude and sign."""
    return -(word & 0x7FFF) if word & 0x8000 else word
