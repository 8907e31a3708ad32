"""A reader of session files, whole, cut off or damaged at any byte.

The readers of the ``mcap`` package refuse a file without a footer, or lose its last chunk. This one yields
what can be trusted and names the first thing that cannot: a chunk has the checksum of its messages, metadata
named ``checksum`` that of everything before them, the end of the data that of the whole file, the footer
that of the summary. A record of a kind that no session has at its place is damage too, so that a chunk is
not lost because a bit of its kind was flipped. Checksums of a whole file are compared in files of contid
only: other programs count other bytes.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator
from typing import BinaryIO, Final

from contid.session.format.mcap_records import (
    ATTACHMENT,
    CHANNEL,
    CHECKSUM,
    CHUNK,
    CHUNK_HEAD,
    DATA_END,
    FOOTER,
    HEADER,
    INDEX,
    LIBRARY,
    MAGIC,
    MESSAGE,
    METADATA,
    RECORD,
    SCHEMA,
    DamagedRecordError,
    decode,
)

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


_U32: Final = struct.Struct("<I")
#: Kinds of records before the end of the data, behind the header.
_IN_DATA: Final = frozenset(
    {SCHEMA, CHANNEL, MESSAGE, CHUNK, _CUT_CHUNK, INDEX, ATTACHMENT, METADATA, DATA_END}
)
#: Kinds of records of the summary, between the end of the data and the footer.
_IN_SUMMARY: Final = frozenset({SCHEMA, CHANNEL, 0x08, 0x0A, 0x0B, 0x0D, 0x0E, FOOTER})
#: Bytes of a footer in front of its checksum, which covers them.
_FOOTER_BYTES: Final = 8 + 8 + 4


class _DamageError(Exception):
    """What is damaged; the place is known to the caller."""


class RecordStream:
    """Records of a file in their order, those inside chunks too, up to the first that is not whole.

    Attributes:
        clean: after the last record: the file has the end that MCAP demands.
        compacted: the file has a compressed chunk, or an index of one.
        damage: what in the file is damaged, and where; "" when nothing is.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.clean = self.compacted = False
        self.damage = ""
        self._crc = 0
        self._budget = FREE_BYTES
        self._of_contid = False

    def __iter__(self) -> Iterator[tuple[int, bytes]]:
        """Opcode and body of every record of the data section."""
        if self._file.read(len(MAGIC)) != MAGIC:
            return
        self._crc = zlib.crc32(MAGIC)
        at, allowed = len(MAGIC), _IN_DATA | {HEADER}
        try:
            for opcode, body in _records(self._file):
                here, at = at, at + RECORD.size + len(body)
                if opcode not in allowed:
                    raise _DamageError(f"a record of kind {opcode}, which is none of a session")
                if allowed is not _IN_SUMMARY:
                    allowed = _IN_DATA  # only the first record is a header
                if opcode == DATA_END:
                    self._check_end(body)
                    allowed = _IN_SUMMARY
                    self._crc = 0
                    continue
                if opcode == FOOTER:
                    self._check_footer(body)
                    self.clean = self._file_ends()
                    return
                if allowed is _IN_DATA:
                    yield from self._contents(opcode, body)
                self._crc = zlib.crc32(body, zlib.crc32(RECORD.pack(max(opcode, 0), len(body)), self._crc))
        except _DamageError as error:
            self.damage = self.damage or f"at byte {here}: {error}"
        except ValueError as error:  # of `_records`
            self.damage = self.damage or f"at byte {at}: {error}"

    def _contents(self, opcode: int, body: bytes) -> Iterator[tuple[int, bytes]]:
        """A record of the data section, or those inside it."""
        if opcode == HEADER:
            self._of_contid = body[4 + int.from_bytes(body[:4], "little") :][4:] == LIBRARY.encode()
        if opcode in (CHUNK, _CUT_CHUNK):
            yield from _records(io.BytesIO(self._unpacked(opcode, body)))
        elif opcode == INDEX:
            self.compacted = True
            if len(body) < 6 or int.from_bytes(body[2:6], "little") != len(body) - 6:
                raise _DamageError("an index without valid content")
        else:
            if opcode == METADATA:
                self._check_metadata(body)
            yield opcode, body

    def _unpacked(self, opcode: int, body: bytes) -> bytes:
        try:
            compression, packed = _packed(body)
            self.compacted = self.compacted or bool(compression)
            self._budget += MAX_EXPANSION * len(body)
            whole = opcode == CHUNK
            inside = (_decoded_chunk if whole else _partial_chunk)(body, compression, packed, self._budget)
        except ValueError as error:
            raise _DamageError(str(error)) from None
        self._budget -= len(inside)
        return inside

    def _check_metadata(self, body: bytes) -> None:
        """Compare a checksum with everything before it; the reading goes on, since the rest has its own."""
        try:
            record = decode(METADATA, body)
        except DamagedRecordError:
            return  # its user reports it
        if self._of_contid and record.name == CHECKSUM and record.metadata.get("crc32") != f"{self._crc:08x}":
            self.damage = self.damage or "the checksum of its head, or of a trajectory, does not match"

    def _check_end(self, body: bytes) -> None:
        if len(body) != _U32.size:
            raise _DamageError("the end of the data without valid content")
        (crc,) = _U32.unpack(body)
        if crc and self._of_contid and crc != self._crc:
            raise _DamageError("the checksum of the whole file does not match")

    def _check_footer(self, body: bytes) -> None:
        if len(body) != _FOOTER_BYTES:
            raise _DamageError("a footer without valid content")
        head = RECORD.pack(FOOTER, len(body)) + body[:-4]
        (crc,) = _U32.unpack(body[-4:])
        if crc and self._of_contid and zlib.crc32(head, self._crc) != crc:
            raise _DamageError("the checksum of its summary does not match")

    def _file_ends(self) -> bool:
        self._file.seek(-len(MAGIC), io.SEEK_END)
        return self._file.read() == MAGIC


def _records(file: BinaryIO) -> Iterator[tuple[int, bytes]]:
    """Whole records up to the first partial one; of a partial chunk its bytes.

    Raises:
        ValueError: a length that no record has, or zeros where a record should be and more behind them.
    """
    data, at, head = b"", 0, RECORD.size
    while True:
        while len(data) - at >= head:
            opcode, length = RECORD.unpack_from(data, at)
            if opcode == 0:
                if _any_but_zeros(data[at:], file):
                    raise ValueError("zeros in place of a record")
                return  # a block at the end that never reached the disk
            if length > _MAX_RECORD_BYTES:
                raise ValueError(f"a record of {length} bytes")
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
            if len(data) - at >= head and data[at] == CHUNK:
                own = _own_length(data[at + head :])
                if own is not None and own != RECORD.unpack_from(data, at)[1]:
                    raise ValueError("a chunk with two lengths")
                yield _CUT_CHUNK, data[at + head :]
            return
        data, at = data[at:] + b"".join(pieces), 0


def _own_length(body: bytes) -> int | None:
    """Length of a chunk by the lengths inside it; None when it is cut off before them."""
    at = CHUNK_HEAD.size + 4 + int.from_bytes(body[CHUNK_HEAD.size : CHUNK_HEAD.size + 4], "little") + 8
    return at + int.from_bytes(body[at - 8 : at], "little") if len(body) >= at else None


def _any_but_zeros(data: bytes, file: BinaryIO) -> bool:
    while data:
        if data.count(0) != len(data):
            return True
        data = file.read(_READ)
    return False


def _decoded_chunk(body: bytes, compression: str, packed: bytes, budget: int) -> bytes:
    """The content of a chunk, of at most ``budget`` bytes.

    Raises:
        ValueError: it is damaged.
    """
    size, crc = _declared_size(body, budget)
    if _own_length(body) != len(body):
        raise ValueError("a chunk with two lengths")
    data = b"".join(_blocks(compression, packed, size))
    if crc and zlib.crc32(data) != crc:
        raise ValueError("the checksum of a chunk does not match")
    return data


def _partial_chunk(body: bytes, compression: str, packed: bytes, budget: int) -> bytes:
    """The whole blocks of a chunk that was cut off.

    Raises:
        ValueError: it is damaged as well.
    """
    if not packed or compression not in ("zstd", ""):
        return b""
    return b"".join(_blocks(compression, packed, _declared_size(body, budget)[0]))


def _declared_size(body: bytes, budget: int) -> tuple[int, int]:
    """Declared size of the content of a chunk, and its checksum.

    Raises:
        ValueError: it has no head, or declares more than `MAX_CHUNK_BYTES` or ``budget``.
    """
    if len(body) < CHUNK_HEAD.size + 4:
        raise ValueError("a chunk has no head")
    size, crc = CHUNK_HEAD.unpack_from(body)[2:]
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
    elif compression == "":
        yield packed
    else:
        raise ValueError(f"a chunk with the unknown compression {compression[:20]!r}")


def _packed(body: bytes) -> tuple[str, bytes]:
    """Name of the compression and compressed bytes of a chunk."""
    at = CHUNK_HEAD.size
    length = int.from_bytes(body[at : at + 4], "little")
    return body[at + 4 : at + 4 + length].decode(errors="replace"), body[at + 4 + length + 8 :]
