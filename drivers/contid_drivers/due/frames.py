"""Frames of the Due protocol: COBS around payload and CRC-16, ended by a zero byte (firmware/PROTOCOL.md)."""

from __future__ import annotations

import binascii
from collections.abc import Iterator
from typing import Final

from cobs import cobs

CRC_START: Final = 0xFFFF
#: Longest payload the board takes, CRC not included.
MAX_PAYLOAD: Final = 640
#: More bytes than any frame has without a zero among them are noise.
_MAX_FRAME: Final = 1024


def crc16(data: bytes) -> int:
    """CRC-16-CCITT (polynomial 0x1021, start 0xFFFF), as the board computes it."""
    return binascii.crc_hqx(data, CRC_START)


def seal(payload: bytes) -> bytes:
    """Payload -> bytes on the wire."""
    return bytes(cobs.encode(payload + crc16(payload).to_bytes(2, "little"))) + b"\0"


def unseal(frame: bytes) -> bytes | None:
    """A frame without its zero -> payload; None when it is damaged."""
    try:
        data = bytes(cobs.decode(frame))
    except cobs.DecodeError:
        return None
    if len(data) < 2 or crc16(data[:-2]) != int.from_bytes(data[-2:], "little"):
        return None
    return data[:-2]


class FrameReader:
    """Bytes as they arrive -> payloads; counts what was no frame."""

    def __init__(self) -> None:
        self._buffer = bytearray()
        self.damaged = 0

    def clear(self) -> None:
        """Forget a half-received frame."""
        self._buffer.clear()

    def feed(self, data: bytes) -> Iterator[bytes]:
        """Yield the payload of every whole frame."""
        self._buffer += data
        while (end := self._buffer.find(0)) >= 0:
            frame = bytes(self._buffer[:end])
            del self._buffer[: end + 1]
            if not frame:
                continue
            payload = unseal(frame)
            if payload is None:
                self.damaged += 1
            else:
                yield payload
        if len(self._buffer) > _MAX_FRAME:
            self._buffer.clear()
            self.damaged += 1
