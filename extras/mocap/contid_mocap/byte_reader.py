"""Reads little-endian fields of a datagram and never beyond its end."""

from __future__ import annotations

import struct
from typing import Any

from contid.errors import ContidError


class PacketError(ContidError):
    """A datagram that does not follow the format of its protocol."""


class ByteReader:
    """A position in a part of a datagram.

    Args:
        data: the datagram.
        start: first byte of the part.
        end: byte behind it; None for the end of the datagram.
    """

    __slots__ = ("_data", "_end", "at")

    def __init__(self, data: bytes, start: int = 0, end: int | None = None) -> None:
        self._data = data
        self._end = len(data) if end is None else end
        self.at = start

    @property
    def left(self) -> int:
        """Bytes that were not read."""
        return self._end - self.at

    def skip(self, size: int) -> None:
        """Go on behind bytes.

        Raises:
            PacketError: there are fewer.
        """
        if not 0 <= size <= self.left:
            raise PacketError(f"{size} bytes are announced at byte {self.at}; {self.left} are there")
        self.at += size

    def take(self, layout: struct.Struct) -> tuple[Any, ...]:
        """The fields of a layout; raises as `skip`."""
        begin = self.at
        self.skip(layout.size)
        return layout.unpack_from(self._data, begin)

    def count(self, least: int) -> int:
        """A number of elements, of which each needs at least that many bytes.

        Raises:
            PacketError: more elements than the rest of the packet can hold.
        """
        (number,) = self.take(_INT32)
        if not 0 <= number * least <= self.left:
            raise PacketError(f"{number} elements are announced at byte {self.at - 4}; they do not fit")
        return int(number)

    def text(self) -> str:
        """A text that ends with a zero byte.

        Raises:
            PacketError: no zero byte follows.
        """
        stop = self._data.find(b"\0", self.at, self._end)
        if stop < 0:
            raise PacketError(f"the text at byte {self.at} has no end")
        found = self._data[self.at : stop]
        self.at = stop + 1
        return found.decode("utf-8", "replace")

    def part(self, size: int) -> ByteReader:
        """A reader of the next bytes, behind which this one goes on; raises as `skip`."""
        begin = self.at
        self.skip(size)
        return ByteReader(self._data, begin, self.at)


_INT32 = struct.Struct("<i")
