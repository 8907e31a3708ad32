"""Compaction of a session: compressed chunks, an index, statistics, and the channel of measured tips.

Message records are copied as bytes; only their heads are decoded, and what the channel `measured` is computed
from (`contid.session.measured_channel`). The new file replaces the old one in one
step, so that a readable session exists at every instant.
"""

from __future__ import annotations

import logging
import struct
import zlib
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path
from typing import BinaryIO, Final

from contid.session.format import mcap_records as mcap
from contid.session.format.channels import TICK_CHANNELS
from contid.session.format.mcap_records import MESSAGE_INSIDE, RECORD, RecordStream
from contid.session.format.summary import SummarySection
from contid.session.measured_channel import MeasuredChannel, ModelFailedError
from contid.session.output import PRIVATE, exists_error, replacing

log = logging.getLogger(__name__)

CHUNK_BYTES: Final = 1 << 20
LEVEL: Final = 3
_PAIR: Final = struct.Struct("<QQ")


def compact(
    source: Path,
    target: Path | None = None,
    note: Mapping[str, Mapping[str, str]] | None = None,
    max_ticks: int | None = None,
) -> Path:
    """Rewrite a session, whole or truncated, as an indexed and compressed one.

    Args:
        source: the session.
        target: a file that does not exist; None replaces ``source``.
        note: metadata to add, by name.
        max_ticks: number of ticks to copy; None for all.

    Returns:
        The new file.

    Raises:
        ContidError: ``target`` exists or cannot be written; ``source`` is unchanged.
    """
    if target is not None and target.exists():
        raise exists_error(target)
    target = target or source
    try:
        measured = MeasuredChannel.of(source)
        if measured is not None:
            _copy(source, target, note or {}, max_ticks, measured)
            return target
    except ModelFailedError as error:  # the recording is worth more than what is computed from it
        log.warning("%s: without the channel measured: %s", source, error)
    _copy(source, target, note or {}, max_ticks, None)
    return target


def _copy(
    source: Path,
    target: Path,
    note: Mapping[str, Mapping[str, str]],
    max_ticks: int | None,
    measured: MeasuredChannel | None,
) -> None:
    with replacing(target, PRIVATE) as new, source.open("rb") as old:
        _Compactor(new, max_ticks, measured).copy(RecordStream(old), note)


class _Compactor:
    """One copy."""

    def __init__(self, out: BinaryIO, max_ticks: int | None, measured: MeasuredChannel | None) -> None:
        self._out = out
        self._measured = measured
        self._declared = False
        self._topics: dict[int, str] = {}
        self._max_ticks, self._ticks = max_ticks, 0
        self._summary = SummarySection()
        self._parts: list[bytes] = []
        self._size = self._time_ns = 0
        self._index: dict[int, list[tuple[int, int]]] = defaultdict(list)
        # Messages of a tick until its last one: an incomplete tick is dropped.
        self._tick: list[bytes] = []
        self._first = self._last = -1

    def copy(self, stream: RecordStream, note: Mapping[str, Mapping[str, str]]) -> None:
        """Copy every whole record and tick, and finish the file."""
        self._out.write(mcap.MAGIC)
        from mcap import records

        copied: set[tuple[int, int]] = set()
        for opcode, body in stream:
            if opcode == mcap.MESSAGE:
                if self._ticks == self._max_ticks:
                    break
                if self._measured is not None and not self._declared:
                    self._declared = True
                    for each in self._measured.declaration():
                        self._write_record(*each)
                self._add_message(body)
                continue
            if opcode in (mcap.SCHEMA, mcap.CHANNEL):
                key = (opcode, int.from_bytes(body[:2], "little"))
                if key in copied:
                    continue
                copied.add(key)
            self._write_record(opcode, body)
        for name, texts in note.items():
            body = mcap.encode(records.Metadata(name=name, metadata=dict(texts)))
            self._write_record(mcap.METADATA, body[RECORD.size :])
        self._chunk()
        self._summary.write(self._out)

    def _add_message(self, body: bytes) -> None:
        channel = int.from_bytes(body[:2], "little")
        if channel == self._first:
            self._tick = [body]
        elif channel == self._last:
            self._tick.append(body)
            for each in self._tick:
                self._write_message(each)
            if self._measured is not None:
                named = {self._topics[int.from_bytes(each[:2], "little")]: each for each in self._tick}
                self._write_message(self._measured.message(named))
            self._tick = []
            self._ticks += 1
        elif self._tick:
            self._tick.append(body)
        else:
            self._write_message(body)

    def _write_message(self, body: bytes) -> None:
        channel, _, time_ns, _ = MESSAGE_INSIDE.unpack_from(body)
        # Only between two times: readers treat chunks whose times overlap as messages out of order.
        if self._size >= CHUNK_BYTES and time_ns != self._time_ns:
            self._chunk()
        self._time_ns = time_ns
        self._index[channel].append((time_ns, self._size))
        self._parts += (RECORD.pack(mcap.MESSAGE, len(body)), body)
        self._size += RECORD.size + len(body)

    def _write_record(self, opcode: int, body: bytes) -> None:
        from mcap import records

        summary, at = self._summary, self._out.tell()
        self._out.write(RECORD.pack(opcode, len(body)) + body)
        if opcode == mcap.SCHEMA:
            summary.schemas.append(mcap.decode(opcode, body))
        elif opcode == mcap.CHANNEL:
            channel = mcap.decode(opcode, body)
            summary.channels.append(channel)
            self._topics[channel.id] = channel.topic
            self._first = channel.id if channel.topic == TICK_CHANNELS[0] else self._first
            self._last = channel.id if channel.topic == TICK_CHANNELS[-1] else self._last
        elif opcode == mcap.METADATA:
            name = mcap.decode(opcode, body).name
            index = records.MetadataIndex(offset=at, length=RECORD.size + len(body), name=name)
            summary.metadata.append(index)
        elif opcode == mcap.ATTACHMENT:
            file = mcap.decode(opcode, body)
            summary.attachments.append(
                records.AttachmentIndex(
                    offset=at,
                    length=RECORD.size + len(body),
                    log_time=file.log_time,
                    create_time=file.create_time,
                    data_size=len(file.data),
                    name=file.name,
                    media_type=file.media_type,
                )
            )

    def _chunk(self) -> None:
        """Write the collected messages as one chunk and its index."""
        if not self._parts:
            return
        import zstandard
        from mcap import records

        body = b"".join(self._parts)
        compressed = zstandard.ZstdCompressor(level=LEVEL).compress(body)
        times = [time_ns for pairs in self._index.values() for time_ns, _ in pairs]
        start_ns, end_ns = min(times), max(times)
        at = self._out.tell()
        self._out.write(
            mcap.encode(records.Chunk("zstd", compressed, end_ns, start_ns, zlib.crc32(body), len(body)))
        )
        index_at = self._out.tell()
        offsets = {}
        for channel, pairs in self._index.items():
            offsets[channel] = self._out.tell()
            entries = b"".join([_PAIR.pack(*pair) for pair in pairs])
            inside = struct.pack("<HI", channel, len(entries)) + entries
            self._out.write(RECORD.pack(mcap.INDEX, len(inside)) + inside)
            self._summary.counts[channel] += len(pairs)
        summary = self._summary
        summary.start_ns = min(start_ns, summary.start_ns) if summary.chunks else start_ns
        summary.end_ns = max(end_ns, summary.end_ns)
        summary.chunks.append(
            records.ChunkIndex(
                chunk_length=index_at - at,
                chunk_start_offset=at,
                compression="zstd",
                compressed_size=len(compressed),
                message_end_time=end_ns,
                message_index_length=self._out.tell() - index_at,
                message_index_offsets=offsets,
                message_start_time=start_ns,
                uncompressed_size=len(body),
            )
        )
        self._parts, self._size, self._index = [], 0, defaultdict(list)
