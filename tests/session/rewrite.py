"""A session rewritten by other programs, with the stock library."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from mcap.reader import SeekingReader
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
