"""Model definitions of NatNet: the names of rigid bodies by number, and those of markers by set.

A list of definitions, each with its kind and from 4.1 its size. Before 4.1 a definition can only be passed
by reading it, so all kinds are read; a kind that is not known ends the list there.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from typing import Final

from contid_mocap.byte_reader import ByteReader
from contid_mocap.natnet.messages import NatNetVersion

_KIND: Final = struct.Struct("<I")
#: Number, parent, offset from it.
_BODY: Final = struct.Struct("<II3f")
_NUMBER: Final = struct.Struct("<I")
#: Of a marker of a body: position and active label.
_MARKER: Final = 12 + 4
#: Of a force plate: width, length, origin, calibration matrix, corners, two kinds.
_PLATE: Final = 4 * (2 + 3 + 144 + 12 + 2)
_KINDS_OF_DEVICE: Final = 8
_CAMERA: Final = 4 * 7


@dataclass(slots=True)
class NatNetModels:
    """Names.

    Attributes:
        bodies: names of rigid bodies by number.
        markers: names of the markers of a set, by the name of the set.
        unknown: kind of definition at which reading had to end, None when all were read.
    """

    bodies: dict[int, str] = field(default_factory=dict)
    markers: dict[str, list[str]] = field(default_factory=dict)
    unknown: int | None = None


def read_models(contents: ByteReader, version: NatNetVersion) -> NatNetModels:
    """Decode model definitions.

    Args:
        contents: what follows the header of the message.
        version: of the stream, one of `VERSIONS`.

    Raises:
        PacketError: counts, sizes or texts that do not fit into the packet.
    """
    models = NatNetModels()
    for _ in range(contents.count(4)):
        (kind,) = contents.take(_KIND)
        reader = contents
        if version >= (4, 1):
            (size,) = contents.take(_NUMBER)
            reader = contents.part(int(size))
        elif kind > 5:
            models.unknown = int(kind)
            return models
        if kind == 0:
            name = reader.text()
            models.markers[name] = [reader.text() for _ in range(reader.count(1))]
        elif kind == 1:
            number, name = _body(reader, version)
            models.bodies[number] = name
        elif version < (4, 1):
            _pass(int(kind), reader, version)
    return models


def _body(reader: ByteReader, version: NatNetVersion) -> tuple[int, str]:
    """Number and name of a rigid body."""
    name = reader.text()
    number, *_ = reader.take(_BODY)
    markers = reader.count(_MARKER)
    reader.skip(markers * _MARKER)
    if version >= (4, 0):
        for _ in range(markers):
            reader.text()
    return int(number), name


def _pass(kind: int, reader: ByteReader, version: NatNetVersion) -> None:
    """Read a definition of kind 2 to 5, which has no name of a body or a marker."""
    if kind == 2:
        reader.text()
        reader.skip(4)
        for _ in range(reader.count(1)):
            _body(reader, version)
    elif kind in (3, 4):
        reader.skip(4)
        reader.text()
        if kind == 4:
            reader.text()
        reader.skip(_PLATE if kind == 3 else _KINDS_OF_DEVICE)
        for _ in range(reader.count(1)):
            reader.text()
    else:
        reader.text()
        reader.skip(_CAMERA)
