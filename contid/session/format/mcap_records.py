"""MCAP records as bytes: what is written in every tick, and a reader that no truncation stops.

The ``mcap`` package writes 24 us per message and buffers, and its readers give up on a file without a footer
or lose the chunk under way. A message record is 31 bytes of head and the JSON; a whole tick goes out in one
``write``. Rare records are built by ``mcap`` itself. Format: https://mcap.dev/spec.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator
from typing import Any, BinaryIO, Final

from contid.errors import ContidError

MAGIC: Final = b"\x89MCAP0\r\n"
LIBRARY: Final = "contid"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, INDEX = 1, 2, 3, 4, 5, 6, 7
ATTACHMENT, METADATA, DATA_END = 0x09, 0x0C, 0x0F
RECORD: Final = struct.Struct("<BQ")
#: opcode, length, channel, sequence, log time [ns], publish time [ns].
MESSAGE_HEAD: Final = struct.Struct("<BQHIQQ")
MESSAGE_INSIDE: Final = struct.Struct("<HIQQ")
_CHUNK_HEAD: Final = struct.Struct("<QQQI")
_READ: Final = 1 << 20
#: Stands for a chunk that has no end.
_CUT_CHUNK: Final = -1
#: No record of a session is longer; a length beyond it is damage.
_LONGEST: Final = 1 << 32
#: Bytes of an unpacked chunk; one that claims more, or holds more than it claims, is damaged, or meant to
#: fill the memory. What its compressed frame says of itself is not asked.
CHUNK_MOST: Final = 1 << 28


class DamagedRecordError(ContidError):
    """A record inside an MCAP file does not hold what its kind does."""


def message(channel: int, sequence: int, time_ns: int, data: bytes) -> bytes:
    """One message record."""
    length = MESSAGE_INSIDE.size + len(data)
    return MESSAGE_HEAD.pack(MESSAGE, length, channel, sequence & 0xFFFFFFFF, time_ns, time_ns) + data


def built(*records: Any) -> bytes:
    """Records of the ``mcap`` package as bytes."""
    from mcap.data_stream import RecordBuilder

    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())


def understood(opcode: int, body: bytes) -> Any:
    """The record of the ``mcap`` package that a body holds (schema, channel, attachment, metadata).

    Raises:
        DamagedRecordError: it is none.
    """
    from mcap import records
    from mcap.data_stream import ReadDataStream
    from mcap.exceptions import McapError

    kinds = {
        SCHEMA: records.Schema,
        CHANNEL: records.Channel,
        ATTACHMENT: records.Attachment,
        METADATA: records.Metadata,
    }
    try:
        return kinds[opcode].read(ReadDataStream(io.BytesIO(body)))
    except (McapError, ValueError, OverflowError, struct.error) as error:
        raise DamagedRecordError(f"a record ({kinds[opcode].__name__}) of the file is damaged") from error


class RecordStream:
    """Records of a file in their order, those inside chunks too, up to the first that is not whole.

    Attributes:
        clean: after the last record: the file ends as MCAP demands.
        chunked: a chunk was seen: the file was compacted.
        damaged: the same: it ended at a chunk that is there but does not hold what it says.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.clean = self.chunked = self.damaged = False

    def __iter__(self) -> Iterator[tuple[int, bytes]]:
        """Opcode and body of every record of the data section."""
        if self._file.read(len(MAGIC)) != MAGIC:
            return
        ended = False
        for opcode, body in _records(self._file):
            if opcode in (CHUNK, _CUT_CHUNK):
                self.chunked = True
                try:
                    inside = _unpacked(body) if opcode == CHUNK else _begun(body)
                except ValueError:
                    self.damaged = opcode == CHUNK
                    return
                yield from _records(io.BytesIO(inside))
            elif opcode == DATA_END:
                ended = True
            elif opcode == FOOTER:
                self.clean = ended and self._file_ends()
                return
            elif opcode != INDEX and not ended:
                yield opcode, body

    def _file_ends(self) -> bool:
        self._file.seek(-len(MAGIC), io.SEEK_END)
        return self._file.read() == MAGIC


def _records(file: BinaryIO) -> Iterator[tuple[int, bytes]]:
    """Whole records, up to the first that is not; of a chunk that was cut off, what there is."""
    data, at, head = b"", 0, RECORD.size
    while True:
        while len(data) - at >= head:
            opcode, length = RECORD.unpack_from(data, at)
            if opcode == 0 or length > _LONGEST:
                return  # zeros of a block that never reached the disk, or other damage
            end = at + head + length
            if end > len(data):
                break
            yield opcode, data[at + head : end]
            at = end
        wanted = _READ
        if len(data) - at >= head:
            wanted = max(_READ, head + RECORD.unpack_from(data, at)[1] - (len(data) - at))
        # In pieces: reading at once would set aside what a damaged length asks for, whatever the file has.
        pieces = []
        while wanted > 0 and (piece := file.read(min(wanted, _READ))):
            pieces.append(piece)
            wanted -= len(piece)
        if not pieces:
            if data[at : at + 1] == bytes([CHUNK]):
                yield _CUT_CHUNK, data[at + head :]
            return
        data, at = data[at:] + b"".join(pieces), 0


def _unpacked(body: bytes) -> bytes:
    """What a chunk holds.

    Raises:
        ValueError: it is damaged.
    """
    size, crc = _claims(body)
    compression, packed = _packed(body)
    data = b"".join(_blocks(compression, packed, size))
    if crc and zlib.crc32(data) != crc:
        raise ValueError("a chunk has another checksum than it says")
    return data


def _begun(body: bytes) -> bytes:
    """What can be had of a chunk that was cut off: its whole blocks.

    Raises:
        ValueError: it is damaged as well.
    """
    if len(body) < _CHUNK_HEAD.size + 4:
        return b""
    compression, packed = _packed(body)
    return b"".join(_blocks(compression, packed, _claims(body)[0])) if compression == "zstd" else b""


def _claims(body: bytes) -> tuple[int, int]:
    """Bytes that a chunk says it holds, and their checksum.

    Raises:
        ValueError: it has no head, or says more than `CHUNK_MOST`.
    """
    if len(body) < _CHUNK_HEAD.size + 4:
        raise ValueError("a chunk has no head")
    size, crc = _CHUNK_HEAD.unpack_from(body)[2:]
    if size > CHUNK_MOST:
        raise ValueError(f"a chunk claims to hold {size} bytes")
    return size, crc


def _blocks(compression: str, packed: bytes, most: int) -> Iterator[bytes]:
    """Unpacked bytes in pieces, never more than ``most`` and a piece of them in memory.

    Raises:
        ValueError: they are damaged, or more than ``most``.
    """
    done = 0
    try:
        for piece in _pieces(compression, packed):
            done += len(piece)
            if done > most:
                raise ValueError(f"a chunk of {most} bytes holds more than it claims")
            yield piece
    except ValueError:
        raise
    except Exception as error:  # each library has errors of its own for damaged data
        raise ValueError(str(error)) from error


def _pieces(compression: str, packed: bytes) -> Iterator[bytes]:
    if compression == "zstd":
        import zstandard

        with zstandard.ZstdDecompressor().stream_reader(packed) as reader:
            while piece := reader.read(_READ):
                yield piece
    elif compression == "lz4":
        import lz4.frame

        unpacking = lz4.frame.LZ4FrameDecompressor()
        piece = unpacking.decompress(packed, max_length=_READ)
        while piece:
            yield piece
            piece = b"" if unpacking.eof else unpacking.decompress(b"", max_length=_READ)
    else:
        yield packed


def _packed(body: bytes) -> tuple[str, bytes]:
    """Name of the compression and compressed bytes of a chunk."""
    at = _CHUNK_HEAD.size
    length = int.from_bytes(body[at : at + 4], "little")
    return body[at + 4 : at + 4 + length].decode(errors="replace"), body[at + 4 + length + 8 :]
