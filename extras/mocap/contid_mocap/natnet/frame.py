"""Frames of motion-capture data of NatNet 3.0 to 4.1.

In this order: number; marker sets, other markers, rigid bodies, skeletons, from 4.1 assets, labelled markers,
force plates, devices; times. Each section begins with its number of elements, from 4.1 followed by its
size, so that what a later version adds to its elements is skipped.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from contid.kinematics.array import Array
from contid.targets import Vec3
from contid_mocap.byte_reader import ByteReader, PacketError
from contid_mocap.natnet.messages import NatNetVersion
from contid_mocap.room import rotation_of, usable_position

_NUMBER: Final = struct.Struct("<I")
_SIZE: Final = struct.Struct("<I")
_VECTOR: Final = struct.Struct("<3f")
#: Number, position, quaternion (x, y, z, w), mean error of the markers, flags.
_BODY: Final = struct.Struct("<I3f4ffH")
#: Number, position, size, flags, residual.
_MARKER: Final = struct.Struct("<I3ffHf")
#: Timecode, its part, seconds of the software; ticks of mid-exposure, reception and transmission.
_TIMES: Final = struct.Struct("<IIdQQQ")
_FLAGS: Final = struct.Struct("<H")
#: From 4.1 seconds and their fraction by a clock of the network stand before the flags.
_PRECISION: Final = struct.Struct("<II")
_TRACKED: Final = 0x01
_OCCLUDED: Final = 0x01
_MODELS_CHANGED: Final = 0x02


@dataclass(frozen=True, eq=False, slots=True)
class NatNetBody:
    """A rigid body.

    Attributes:
        position_m, rotation: in the room; None when it is not tracked, or its numbers are no pose.
        error_m: mean distance of its markers from their places.
    """

    position_m: Vec3 | None
    rotation: Array | None
    error_m: float


@dataclass(frozen=True, slots=True)
class NatNetFrame:
    """A frame.

    Attributes:
        number: counts up from the start of the server, 32 bits.
        bodies: rigid bodies by number.
        sets: positions of the markers of a set by its name, in the order of its definition [m].
        occluded: positions of labelled markers that no camera has seen [m].
        exposed, sent: ticks of the server's clock at mid-exposure (0 when it is not known) and transmission.
        models_changed: names are to be requested again.
    """

    number: int
    bodies: dict[int, NatNetBody]
    sets: dict[str, list[Vec3]]
    occluded: frozenset[Vec3]
    exposed: int
    sent: int
    models_changed: bool


def read_frame(contents: ByteReader, version: NatNetVersion) -> NatNetFrame:
    """Decode a frame.

    Args:
        contents: what follows the header of the message.
        version: of the stream, one of `VERSIONS`.

    Raises:
        PacketError: counts, sizes or fields that do not fit into the packet.
    """
    sized = version >= (4, 1)
    bodies: dict[int, NatNetBody] = {}
    sets: dict[str, list[Vec3]] = {}
    occluded: set[Vec3] = set()

    def marker_set(reader: ByteReader) -> None:
        name = reader.text()
        sets[name] = [_vector(reader) for _ in range(reader.count(_VECTOR.size))]

    def labelled(reader: ByteReader) -> None:
        _, x, y, z, _, flags, _ = reader.take(_MARKER)
        if flags & _OCCLUDED:
            occluded.add((x, y, z))

    def body(reader: ByteReader) -> None:
        number, found = _body(reader)
        bodies[number] = found

    (number,) = contents.take(_NUMBER)
    _section(contents, sized, 5, marker_set)
    _section(contents, sized, _VECTOR.size, _skip_vector)
    _section(contents, sized, _BODY.size, body)
    _section(contents, sized, 8, _skip_skeleton)
    if sized:
        _section(contents, sized, 12, _skip_asset)
    _section(contents, sized, _MARKER.size, labelled)
    _section(contents, sized, 8, _skip_channels)
    _section(contents, sized, 8, _skip_channels)
    _, _, _, exposed, _, sent = contents.take(_TIMES)
    if sized and contents.left >= _PRECISION.size + _FLAGS.size:
        contents.skip(_PRECISION.size)
    (flags,) = contents.take(_FLAGS)
    changed = bool(flags & _MODELS_CHANGED)
    return NatNetFrame(int(number), bodies, sets, frozenset(occluded), int(exposed), int(sent), changed)


def _section(contents: ByteReader, sized: bool, least: int, read: Callable[[ByteReader], None]) -> None:
    """Read the elements of a section, of which each has at least that many bytes."""
    number = contents.count(least)
    reader = contents
    if sized:
        (size,) = contents.take(_SIZE)
        reader = contents.part(int(size))
        if number * least > reader.left:
            raise PacketError(f"{number} elements do not fit into a section of {size} bytes")
    for _ in range(number):
        read(reader)


def _vector(reader: ByteReader) -> Vec3:
    x, y, z = reader.take(_VECTOR)
    return (x, y, z)


def _body(reader: ByteReader) -> tuple[int, NatNetBody]:
    number, x, y, z, qx, qy, qz, qw, error_m, flags = reader.take(_BODY)
    rotation = rotation_of((qx, qy, qz, qw)) if flags & _TRACKED and usable_position((x, y, z)) else None
    position = None if rotation is None else (x, y, z)
    return int(number), NatNetBody(position, rotation, float(error_m))


def _skip_vector(reader: ByteReader) -> None:
    reader.skip(_VECTOR.size)


def _skip_skeleton(reader: ByteReader) -> None:
    reader.skip(4)
    reader.skip(reader.count(_BODY.size) * _BODY.size)


def _skip_asset(reader: ByteReader) -> None:
    _skip_skeleton(reader)
    reader.skip(reader.count(_MARKER.size) * _MARKER.size)


def _skip_channels(reader: ByteReader) -> None:
    """Force plates and devices: number, channels, each with its samples."""
    reader.skip(4)
    for _ in range(reader.count(4)):
        reader.skip(reader.count(4) * 4)
