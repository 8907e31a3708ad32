"""Packets of a NatNet server, 3.0 to 4.1, as Motive sends them.

Layout: `PacketClient.cpp` of the NatNet SDK; from 4.1 every section has its size behind its count.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

Version: TypeAlias = tuple[int, int]
Point: TypeAlias = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class SentBody:
    """A rigid body of a frame: number, position [m], quaternion, mean error [m], flags (1: tracked)."""

    number: int
    position: Point
    quaternion: tuple[float, float, float, float]
    error: float = 0.0
    flags: int = 1


@dataclass(frozen=True, slots=True)
class SentMarker:
    """A labelled marker: number, position, size, flags (1: occluded), residual."""

    number: int
    position: Point
    size: float = 0.01
    flags: int = 10
    residual: float = 0.0


@dataclass(frozen=True, slots=True)
class SentTimes:
    """Times of a frame: seconds of the software; ticks of exposure, reception and transmission."""

    software_s: float
    exposed: int
    received: int
    sent: int


@dataclass(frozen=True, slots=True)
class SentFrame:
    """A frame.

    Attributes:
        number: of the frame.
        times: of the frame.
        sets: marker sets with the positions of their markers.
        others: positions of other markers.
        bodies, skeletons, labelled: what was found; a skeleton is its number and its bodies.
        assets: from 4.1: number, bodies, markers.
        channels: of force plates: number and samples of each channel; devices have the same form.
        devices: see above.
        flags: of the frame (2: the models have changed).
        tag: an end-of-data tag follows.
    """

    number: int
    times: SentTimes
    sets: Sequence[tuple[str, Sequence[Point]]] = ()
    others: Sequence[Point] = ()
    bodies: Sequence[SentBody] = ()
    skeletons: Sequence[tuple[int, Sequence[SentBody]]] = ()
    labelled: Sequence[SentMarker] = ()
    assets: Sequence[tuple[int, Sequence[SentBody], Sequence[SentMarker]]] = ()
    plates: Sequence[tuple[int, Sequence[Sequence[float]]]] = ()
    devices: Sequence[tuple[int, Sequence[Sequence[float]]]] = ()
    flags: int = 0
    tag: bool = True


def frame_packet(frame: SentFrame, version: Version) -> bytes:
    """A frame of motion-capture data."""
    sections = [
        [_text(name) + _counted(_points(points), len(points)) for name, points in frame.sets],
        [_points([point]) for point in frame.others],
        [_body(body) for body in frame.bodies],
        [_skeleton(number, bodies) for number, bodies in frame.skeletons],
    ]
    if version >= (4, 1):
        sections.append(
            [_skeleton(number, bodies) + _counted(b"".join(map(_marker, markers)), len(markers))
             for number, bodies, markers in frame.assets]
        )  # fmt: skip
    sections.append([_marker(marker) for marker in frame.labelled])
    sections.append([_channels(*each) for each in frame.plates])
    sections.append([_channels(*each) for each in frame.devices])
    data = struct.pack("<i", frame.number)
    for section in sections:
        body = b"".join(section)
        data += struct.pack("<i", len(section))
        data += struct.pack("<i", len(body)) + body if version >= (4, 1) else body
    times = frame.times
    data += struct.pack("<2id3Q", 0, 0, times.software_s, times.exposed, times.received, times.sent)
    if version >= (4, 1):
        data += struct.pack("<2I", 0, 0)
    data += struct.pack("<h", frame.flags) + (struct.pack("<i", 0) if frame.tag else b"")
    return message(7, data)


def models_packet(bodies: dict[int, str], sets: dict[str, list[str]], version: Version) -> bytes:
    """Model definitions of rigid bodies with three markers each, and of marker sets."""
    definitions = []
    for name, markers in sets.items():
        names = b"".join(map(_text, markers))
        definitions.append((0, _text(name) + _counted(names, len(markers))))
    for number, name in bodies.items():
        data = _text(name) + struct.pack("<2i3f", number, -1, 0.0, 0.0, 0.0)
        data += struct.pack("<i", 3) + _points([(0.0, 0.0, 0.0)] * 3) + struct.pack("<3i", 0, 0, 0)
        if version >= (4, 0):
            data += b"".join(_text(f"Marker{k}") for k in (1, 2, 3))
        definitions.append((1, data))
    data = struct.pack("<i", len(definitions))
    for kind, definition in definitions:
        data += struct.pack("<i", kind)
        data += struct.pack("<i", len(definition)) if version >= (4, 1) else b""
        data += definition
    return message(5, data)


def server_packet(version: Version, ticks_per_s: int, port: int, group: bytes | None) -> bytes:
    """What a server answers to a connection."""
    name = b"Emulated Motive".ljust(256, b"\0")
    data = name + bytes((3, 1, 0, 0)) + bytes((*version, 0, 0))
    data += struct.pack("<QH?4s", ticks_per_s, port, group is not None, group or bytes(4))
    return message(1, data)


def echo_packet(sent: int, ticks: int) -> bytes:
    """The answer to an echo request."""
    return message(13, struct.pack("<QQ", sent, ticks))


def message(number: int, data: bytes) -> bytes:
    """A message with its header."""
    return struct.pack("<HH", number, len(data)) + data


def _text(text: str) -> bytes:
    return text.encode() + b"\0"


def _counted(data: bytes, number: int) -> bytes:
    return struct.pack("<i", number) + data


def _points(points: Iterable[Point]) -> bytes:
    return b"".join(struct.pack("<3f", *point) for point in points)


def _body(body: SentBody) -> bytes:
    pose = (*body.position, *body.quaternion)
    return struct.pack("<i8fh", body.number, *pose, body.error, body.flags)


def _marker(marker: SentMarker) -> bytes:
    return struct.pack("<i4fhf", marker.number, *marker.position, marker.size, marker.flags, marker.residual)


def _skeleton(number: int, bodies: Sequence[SentBody]) -> bytes:
    return struct.pack("<i", number) + _counted(b"".join(map(_body, bodies)), len(bodies))


def _channels(number: int, channels: Sequence[Sequence[float]]) -> bytes:
    data = b"".join(struct.pack(f"<i{len(each)}f", len(each), *each) for each in channels)
    return struct.pack("<i", number) + _counted(data, len(channels))
