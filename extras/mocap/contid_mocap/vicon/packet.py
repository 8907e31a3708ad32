"""Packets of the Vicon UDP object stream: 256, 512 or 1024 bytes, several a frame where objects do not fit.

Frame number (uint32), number of items (uint8), then items: kind (uint8, 0 for an object), size (uint16),
and of an object its name (24 bytes), position (3 doubles, mm) and Euler angles (3 doubles, rad). Zeros fill
the block.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.kinematics.array import Array
from contid.targets import Vec3
from contid.units import MM_PER_M
from contid_mocap.byte_reader import ByteReader, PacketError
from contid_mocap.room import RoomPose, usable_position

BLOCKS: Final = (256, 512, 1024)
PORT: Final = 51001
_HEAD: Final = struct.Struct("<IB")
_ITEM: Final = struct.Struct("<BH")
_OBJECT: Final = struct.Struct("<24s6d")
_KIND_OBJECT: Final = 0
#: No angle that a program sends is larger [rad].
_MAX_RAD: Final = 100.0


@dataclass(frozen=True, slots=True)
class ViconPacket:
    """A packet.

    Attributes:
        number: of the frame, 32 bits.
        poses: objects by name; None of one that is lost (all numbers 0), or has no pose.
    """

    number: int
    poses: dict[str, RoomPose | None]


def read_packet(datagram: bytes, fixed_axes: bool = False) -> ViconPacket:
    """Decode a packet.

    Args:
        datagram: as received.
        fixed_axes: the angles turn about the axes of the room, x first, instead of those of the object.

    Raises:
        PacketError: another size than a block has, or items that do not fit.
    """
    if len(datagram) not in BLOCKS:
        raise PacketError(f"a packet of {len(datagram)} bytes; blocks have 256, 512 or 1024")
    reader = ByteReader(datagram)
    number, items = reader.take(_HEAD)
    poses: dict[str, RoomPose | None] = {}
    for _ in range(items):
        kind, size = reader.take(_ITEM)
        item = reader.part(int(size))
        if kind == _KIND_OBJECT:
            name, *values = item.take(_OBJECT)
            text = name.partition(b"\0")[0].decode("utf-8", "replace")
            poses[text] = _pose(values, fixed_axes)
    return ViconPacket(int(number), poses)


def rotation_of_angles(angles_rad: Vec3, fixed_axes: bool) -> Array:
    """The rotation object to room of Euler angles XYZ, shape ``(3, 3)``.

    ``Rx Ry Rz`` about the axes of the object, ``Rz Ry Rx`` about those of the room.
    """
    (cx, sx), (cy, sy), (cz, sz) = ((math.cos(a), math.sin(a)) for a in angles_rad)
    turn_x = np.array([[1.0, 0.0, 0.0], [0.0, cx, -sx], [0.0, sx, cx]])
    turn_y = np.array([[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]])
    turn_z = np.array([[cz, -sz, 0.0], [sz, cz, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(turn_z @ turn_y @ turn_x if fixed_axes else turn_x @ turn_y @ turn_z)


def _pose(values: list[float], fixed_axes: bool) -> RoomPose | None:
    x, y, z, a, b, c = values
    position = (x / MM_PER_M, y / MM_PER_M, z / MM_PER_M)
    if not any(values) or not usable_position(position) or not all(abs(v) <= _MAX_RAD for v in (a, b, c)):
        return None
    return RoomPose(position, rotation_of_angles((a, b, c), fixed_axes))
