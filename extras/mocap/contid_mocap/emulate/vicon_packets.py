"""Packets of a Vicon UDP object stream."""

from __future__ import annotations

import struct
from collections.abc import Mapping

#: Position [mm] and Euler angles XYZ [rad].
SentObject = tuple[float, float, float, float, float, float]


def object_packets(number: int, objects: Mapping[str, SentObject], block: int) -> list[bytes]:
    """A frame as blocks of a size; as many as its objects need.

    Args:
        number: of the frame.
        objects: by name, of which 23 bytes are sent; all numbers 0 where an object is lost.
        block: 256, 512 or 1024 bytes.
    """
    fit = (block - 5) // 75
    names = list(objects)
    packets = []
    for begin in range(0, max(len(names), 1), fit):
        part = names[begin : begin + fit]
        items = b"".join(struct.pack("<BH24s6d", 0, 72, name.encode()[:23], *objects[name]) for name in part)
        packets.append((struct.pack("<IB", number % 2**32, len(part)) + items).ljust(block, b"\0"))
    return packets
