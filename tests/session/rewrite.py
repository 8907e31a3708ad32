"""A session rewritten by other programs, with the stock library, and as earlier versions recorded it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from mcap.data_stream import RecordBuilder
from mcap.reader import SeekingReader
from mcap.records import DataEnd, Metadata
from mcap.stream_reader import StreamReader
from mcap.writer import Writer


def rewritten(
    source: Path,
    target: Path,
    robot_file: Callable[[str], str] = str,
    *,
    metadata: bool = True,
    attachments: bool = True,
) -> Path:
    """Output of `mcap filter` and `mcap sort`: a channel comes just before its first message."""
    with source.open("rb") as old, target.open("wb") as new:
        reader, writer = SeekingReader(old), Writer(new)
        writer.start()
        for each in reader.iter_metadata() if metadata else ():
            texts = dict(each.metadata)
            if each.name == "robot_file":
                texts["text"] = robot_file(texts["text"])
            writer.add_metadata(each.name, texts)
        for file in reader.iter_attachments() if attachments else ():
            writer.add_attachment(file.create_time, file.log_time, file.name, file.media_type, file.data)
        known: dict[int, int] = {}
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            if channel.id not in known:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                known[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, number)
            writer.add_message(
                known[channel.id], message.log_time, message.data, message.publish_time, message.sequence
            )
        writer.finish()
    return target


def without_checksums(source: Path, target: Path) -> Path:
    """A session that was not compacted, as contid 0.1 recorded it first: plain messages, no checksums."""
    with source.open("rb") as old:
        builder = RecordBuilder()
        for record in StreamReader(old).records:  # those of chunks too
            if isinstance(record, Metadata) and record.name == "checksum":
                continue
            (DataEnd(0) if isinstance(record, DataEnd) else record).write(builder)
    magic = source.read_bytes()[:8]
    target.write_bytes(magic + builder.end() + magic)
    return target
