"""Mutations that get past the first check: what is inside a frame, a record or a chunk changes.

Its lengths and checksums fit again afterwards.
"""

from __future__ import annotations

import io
import random
import struct
import zlib
from collections.abc import Callable

from contid.session.format import mcap_records as mcap
from contid.session.format.record_stream import RecordStream
from contid_drivers.due.frames import FrameReader, seal
from contid_drivers.dynamixel import packets

#: Changes bytes at random.
Mutate = Callable[[bytes, random.Random], bytes]


def dynamixel(data: bytes, dice: random.Random, mutate: Mutate) -> bytes:
    """Packets with other parameters and good checksums."""
    left, out = bytearray(data), b""
    while (packet := packets.take(left)) is not None:
        error = bytes((packet.error,)) if packet.instruction == packets.Instruction.STATUS else b""
        inside = error + packet.parameters
        inside = (mutate(inside, dice) if dice.random() < 0.5 else inside)[: packets.LENGTH_MAX // 2]
        out += packets.build(packet.device, packet.instruction, inside)
    return out


def due(data: bytes, dice: random.Random, mutate: Mutate) -> bytes:
    """Frames with other payloads and good checksums."""
    payloads = FrameReader().feed(data)
    return b"".join(seal(mutate(each, dice) if dice.random() < 0.5 else each) for each in payloads)


def records(data: bytes) -> list[tuple[int, bytes]]:
    """The data section of a session, out of its chunks."""
    return list(RecordStream(io.BytesIO(data)))


def joined(parts: list[tuple[int, bytes]]) -> bytes:
    return b"".join(mcap.RECORD.pack(opcode, len(body)) + body for opcode, body in parts)


def file_of(inside: bytes) -> bytes:
    """A file that ends as MCAP demands."""
    end = mcap.RECORD.pack(mcap.DATA_END, 4) + bytes(4) + mcap.RECORD.pack(mcap.FOOTER, 20) + bytes(20)
    return mcap.MAGIC + inside + end + mcap.MAGIC


def chunk(inside: bytes, claims: int) -> bytes:
    """A compressed chunk with a good checksum."""
    import zstandard

    packed = zstandard.ZstdCompressor(level=1).compress(inside)
    head = struct.pack("<QQQI", 0, 0, claims, zlib.crc32(inside)) + struct.pack("<I", 4) + b"zstd"
    body = head + struct.pack("<Q", len(packed)) + packed
    return mcap.RECORD.pack(mcap.CHUNK, len(body)) + body


def session(data: bytes, dice: random.Random, mutate: Mutate) -> bytes:
    """A session in which one record is changed; half of them in a chunk."""
    parts = records(data)
    kinds = sorted({opcode for opcode, _ in parts})
    if not kinds:
        return mutate(data, dice)
    kind = dice.choice(kinds)
    at = dice.choice([i for i, (opcode, _) in enumerate(parts) if opcode == kind])
    body = parts[at][1]
    keep = mcap.MESSAGE_INSIDE.size if kind == mcap.MESSAGE and dice.random() < 0.8 else 0
    parts[at] = kind, body[:keep] + mutate(body[keep:], dice)
    if dice.random() < 0.5:
        return file_of(joined(parts))
    first = next((i for i, (opcode, _) in enumerate(parts) if opcode == mcap.MESSAGE), len(parts))
    inside = joined(parts[first:])
    claims = len(inside) if dice.random() < 0.8 else dice.choice((0, 1, 1 << 20, 1 << 28, 1 << 40))
    return file_of(joined(parts[:first]) + chunk(inside, claims))


#: By target of `tests.campaign.bad_input`.
SHAPES: dict[str, Callable[[bytes, random.Random, Mutate], bytes]] = {
    shape.__name__: shape for shape in (dynamixel, due, session)
}
