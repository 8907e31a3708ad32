"""Frames of the Due protocol, and the serial port that carries requests and answers in them.

A frame is COBS of payload and CRC-16, ended by a zero byte (firmware/PROTOCOL.md).
"""

from __future__ import annotations

import binascii
import os
import select
import time
from collections.abc import Iterator
from typing import Final

from cobs import cobs

from contid.kit.locked_port import PORT_ERRORS, LockedPort

#: Exact on both chips of the programming port; the native port ignores it.
BAUD: Final = 250_000
CRC_START: Final = 0xFFFF
#: More bytes than this without a zero are noise.
_MAX_FRAME: Final = 1024


def crc16(data: bytes) -> int:
    """CRC-16-CCITT: polynomial 0x1021, start 0xFFFF."""
    return binascii.crc_hqx(data, CRC_START)


def seal(payload: bytes) -> bytes:
    """Bytes on the wire of a payload."""
    return bytes(cobs.encode(payload + crc16(payload).to_bytes(2, "little"))) + b"\0"


def unseal(frame: bytes) -> bytes | None:
    """Payload of a frame without its zero; None when it is damaged."""
    try:
        data = bytes(cobs.decode(frame))
    except cobs.DecodeError:
        return None
    if len(data) < 2 or crc16(data[:-2]) != int.from_bytes(data[-2:], "little"):
        return None
    return data[:-2]


class FrameReader:
    """Splits received bytes into payloads; damaged frames are dropped."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, data: bytes) -> Iterator[bytes]:
        """Yield the payload of every whole frame."""
        self._buffer += data
        while (end := self._buffer.find(0)) >= 0:
            frame = bytes(self._buffer[:end])
            del self._buffer[: end + 1]
            if (payload := unseal(frame)) is not None:
                yield payload
        if len(self._buffer) > _MAX_FRAME:
            self._buffer.clear()


class DuePort(LockedPort):
    """Frames over a serial device."""

    def __init__(self, device: str, path: str) -> None:
        super().__init__(device, path, BAUD)
        self._reader = FrameReader()

    def ask(self, payload: bytes, deadline: float) -> bytes | None:
        """Send a request; return the payload of its answer, None after the deadline.

        Args:
            payload: the request; its third byte is the sequence number.
            deadline: when to give up, by `time.monotonic` [s].

        Raises:
            DeviceLostError: the device is gone.
        """
        self._write(seal(payload), deadline)
        while data := self.receive(deadline):
            answers = [one for one in self._reader.feed(data) if one[2:3] == payload[2:3]]
            if answers:
                return answers[-1]
        return None

    def _write(self, data: bytes, deadline: float) -> None:
        try:
            while data:
                _, ready, _ = select.select([], [self.fd], [], max(0.0, deadline - time.monotonic()))
                if not ready:
                    return  # the buffer stays full; the caller's time-out follows
                data = data[os.write(self.fd, data) :]
        except PORT_ERRORS as error:
            raise self.lost(error) from error
