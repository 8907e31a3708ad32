"""MCAP records as bytes: messages and chunks of every tick, and their checksums.

The ``mcap`` package takes 24 us per message and buffers. A message record is 31 bytes of head and the JSON;
one ``write`` takes a whole tick, a chunk of 49 bytes of head and its messages. ``mcap`` itself encodes the
rare records. Format: https://mcap.dev/spec.
"""

from __future__ import annotations

import io
import struct
import zlib
from typing import Any, Final

from contid.errors import ContidError

MAGIC: Final = b"\x89MCAP0\r\n"
LIBRARY: Final = "contid"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, INDEX = 1, 2, 3, 4, 5, 6, 7
ATTACHMENT, METADATA, DATA_END = 0x09, 0x0C, 0x0F
RECORD: Final = struct.Struct("<BQ")
#: opcode, length, channel, sequence, log time [ns], publish time [ns].
MESSAGE_HEAD: Final = struct.Struct("<BQHIQQ")
MESSAGE_INSIDE: Final = struct.Struct("<HIQQ")
#: Times of the first and the last message [ns], bytes of the messages, their CRC-32.
CHUNK_HEAD: Final = struct.Struct("<QQQI")
#: Name of the metadata with the CRC-32 of everything before it in the file.
CHECKSUM: Final = "checksum"


class DamagedRecordError(ContidError):
    """A record inside an MCAP file does not have the content of its kind."""


def message(channel: int, sequence: int, time_ns: int, data: bytes) -> bytes:
    """Compose a message record."""
    length = MESSAGE_INSIDE.size + len(data)
    return MESSAGE_HEAD.pack(MESSAGE, length, channel, sequence & 0xFFFFFFFF, time_ns, time_ns) + data


def plain_chunk(messages: bytes | bytearray, start_ns: int, end_ns: int) -> bytes:
    """Compose an uncompressed chunk of message records, with their checksum."""
    size = len(messages)
    head = CHUNK_HEAD.pack(start_ns, end_ns, size, zlib.crc32(messages))
    return b"".join(
        (RECORD.pack(CHUNK, len(head) + 4 + 8 + size), head, bytes(4), size.to_bytes(8, "little"), messages)
    )


def checksum(crc: int) -> bytes:
    """Compose the metadata that holds the CRC-32 of everything before it."""
    from mcap.records import Metadata

    return encode(Metadata(name=CHECKSUM, metadata={"crc32": f"{crc:08x}"}))


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
