"""MCAP records as bytes: messages for every tick, and a reader of truncated files.

The ``mcap`` package takes 24 us per message and buffers; its readers reject a file without a footer or lose
the last chunk. A message record is 31 bytes of head and the JSON; one ``write`` takes a whole tick. ``mcap``
itself encodes the rare records. Format: https://mcap.dev/spec.
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
#: Opcode of a chunk without an end.
_CUT_CHUNK: Final = -1
#: No record of a session is longer; a length beyond it is damage.
_MAX_RECORD_BYTES: Final = 1 << 32
#: A chunk that declares or holds more bytes than this is damaged, or made to fill the memory; those of contid
#: have 1 MB. The size in its compressed frame is not used.
MAX_CHUNK_BYTES: Final = 1 << 25
#: All chunks together hold at most this many times their compressed bytes, beyond `FREE_BYTES`: a robot
#: that stands still for ten minutes is packed 30-fold, zeros 10 000-fold. Bounds the time of reading.
MAX_EXPANSION: Final = 300
FREE_BYTES: Final = 1 << 22


class DamagedRecordError(ContidError):
    """A record inside an MCAP file does not have the content of its kind."""


def message(channel: int, sequence: int, time_ns: int, data: bytes) -> bytes:
    """Compose a message record."""
    length = MESSAGE_INSIDE.size + len(data)
    return MESSAGE_HEAD.pack(MESSAGE, length, channel, sequence & 0xFFFFFFFF, time_ns, time_ns) + data


def encode(*records: Any) -> bytes:
    """Records of the ``mcap`` package as bytes."""
    from mcap.data_stream import RecordBuilder

    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())


def decode(opcode: int, body: bytes) -> Any:
    """A schema, channel, attachment or metadata as a record of the ``mcap`` package.

    Raises:
        DamagedRecordError: the body is damaged.
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
        clean: after the last record: the file has the end that MCAP demands.
        chunked: the file has a chunk: it was compacted.
        damage: why reading ended at a whole chunk with damaged content, and where; "" when it did not.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.clean = self.chunked = False
        self.damage = ""

    def __iter__(self) -> Iterator[tuple[int, bytes]]:
        """Opcode and body of every record of the data section."""
        if self._file.read(len(MAGIC)) != MAGIC:
            return
        ended, at, budget = False, len(MAGIC), FREE_BYTES
        for opcode, body in _records(self._file):
            here, at = at, at + RECORD.size + len(body)
            if opcode in (CHUNK, _CUT_CHUNK):
                self.chunked = True
                budget += MAX_EXPANSION * len(body)
                try:
                    inside = _decoded_chunk(body, budget) if opcode == CHUNK else _partial_chunk(body, budget)
                except ValueError as error:
                    self.damage = f"at byte {here}: {error}" if opcode == CHUNK else ""
                    return
                budget -= len(inside)
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
    """Whole records up to the first partial one; of a partial chunk its bytes."""
    data, at, head = b"", 0, RECORD.size
    while True:
        while len(data) - at >= head:
            opcode, length = RECORD.unpack_from(data, at)
            if opcode == 0 or length > _MAX_RECORD_BYTES:
                return  # zeros of a block that never reached the disk, or other damage
            end = at + head + length
            if end > len(data):
                break
            yield opcode, data[at + head : end]
            at = end
        missing = _READ
        if len(data) - at >= head:
            missing = max(_READ, head + RECORD.unpack_from(data, at)[1] - (len(data) - at))
        # In pieces: a damaged length must not allocate more than the file has.
        pieces = []
        while missing > 0 and (piece := file.read(min(missing, _READ))):
            pieces.append(piece)
            missing -= len(piece)
        if not pieces:
            if data[at : at + 1] == bytes([CHUNK]):
                yield _CUT_CHUNK, data[at + head :]
            return
        data, at = data[at:] + b"".join(pieces), 0


def _decoded_chunk(body: bytes, budget: int) -> bytes:
    """The content of a chunk, of at most ``budget`` bytes.

    Raises:
        ValueError: it is damaged.
    """
    size, crc = _declared_size(body, budget)
    compression, packed = _packed(body)
    data = b"".join(_blocks(compression, packed, size))
    if crc and zlib.crc32(data) != crc:
        raise ValueError("the checksum of a chunk does not match")
    return data


def _partial_chunk(body: bytes, budget: int) -> bytes:
    """The whole blocks of a chunk that was cut off.

    Raises:
        ValueError: it is damaged as well.
    """
    if len(body) < _CHUNK_HEAD.size + 4:
        return b""
    compression, packed = _packed(body)
    if compression != "zstd":
        return b""
    return b"".join(_blocks(compression, packed, _declared_size(body, budget)[0]))


def _declared_size(body: bytes, budget: int) -> tuple[int, int]:
    """Declared size of the content of a chunk, and its checksum.

    Raises:
        ValueError: it has no head, or declares more than `MAX_CHUNK_BYTES` or ``budget``.
    """
    if len(body) < _CHUNK_HEAD.size + 4:
        raise ValueError("a chunk has no head")
    size, crc = _CHUNK_HEAD.unpack_from(body)[2:]
    if size > MAX_CHUNK_BYTES:
        raise ValueError(f"a chunk declares {size} bytes; at most {MAX_CHUNK_BYTES} are read")
    if size > budget:
        raise ValueError(f"its chunks expand more than {MAX_EXPANSION}-fold, as no session of contid does")
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
                raise ValueError(f"a chunk of {most} bytes holds more than it declares")
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
