"""The answer to a fast sync read, taken apart while it arrives.

It is one packet to which every servo adds ``ERROR ID DATA CRC``, each CRC over all bytes before it. Its
length is fixed in advance, so it has no stuffing. Source: e-manual, Protocol 2.0, Fast Sync Read.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

from contid_drivers.dynamixel.packets import BROADCAST, HEADER, Instruction, crc16

#: Bytes before the first part: header 4, id, length 2, instruction.
HEAD: Final = 8
#: Bytes of a part around its data: error, id, CRC 2.
PART_OVERHEAD: Final = 4
_START: Final = HEADER + bytes((BROADCAST,))


class Part(NamedTuple):
    """The part of a fast answer that one servo sends."""

    device: int
    error: int
    data: bytes


class FastAnswer:
    """Bytes received since one fast sync read.

    Args:
        ids: ids of the servos, in the order of the read.
        size: bytes read from each.
    """

    def __init__(self, ids: Sequence[int], size: int) -> None:
        self._ids = ids
        #: Servos whose part has not arrived intact.
        self.missing = len(ids)
        self._step = size + PART_OVERHEAD
        self._whole = HEAD + self._step * len(ids)
        self._stream = bytearray()
        self._start = self._at = 0
        self._checked = self._crc = 0  # the CRC of the bytes up to the CRC of the newest part
        self._damaged = False
        #: Answers to other fast reads that came before this one.
        self.late = 0

    def feed(self, data: bytes) -> list[Part]:
        """Parts that ``data`` completes, up to the first damaged one."""
        stream, step, parts = self._stream, self._step, list[Part]()
        stream += data
        if not self._at and not self._begun():
            return parts
        # A part that follows a damaged one cannot be checked, because its CRC includes the damage.
        while self.missing and not self._damaged and len(stream) >= self._at + step:
            at, end = self._at, self._at + step - 2
            crc = crc16(stream[self._checked : end], self._crc)
            device = stream[at + 1]
            if device != self._ids[-self.missing] or crc != stream[end] | stream[end + 1] << 8:
                self._damaged = True
                break
            self._crc, self._checked, self._at = crc, end, at + step
            self.missing -= 1
            parts.append(Part(device, stream[at], bytes(stream[at + 2 : end])))
        return parts

    def _begun(self) -> bool:
        """Find the head; skips instructions (an echo) and answers of other lengths, which are late ones."""
        stream, late, at = self._stream, 0, self._stream.find(_START)
        while 0 <= at <= len(stream) - HEAD:
            if stream[at + 7] == Instruction.STATUS:
                if stream[at + 5] | stream[at + 6] << 8 == self._whole - 7:
                    self._at, self._checked = at + HEAD, at
                    break
                late += 1
            at = stream.find(_START, at + 1)
        self._start, self.late = at if at >= 0 else len(stream), late
        return self._at > 0

    @property
    def started(self) -> bool:
        """The answer, or what may be its first bytes, has arrived."""
        return self._start < len(self._stream)
