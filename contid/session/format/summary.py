"""The end of an indexed MCAP file: statistics, and where chunks, attachments and metadata are."""

from __future__ import annotations

import struct
import zlib
from collections import defaultdict
from dataclasses import dataclass, field
from typing import Any, BinaryIO

from contid.session.format import mcap_records as mcap


@dataclass(slots=True)
class SummarySection:
    """Collected while the file is written, for its end."""

    schemas: list[Any] = field(default_factory=list)
    channels: list[Any] = field(default_factory=list)
    chunks: list[Any] = field(default_factory=list)
    attachments: list[Any] = field(default_factory=list)
    metadata: list[Any] = field(default_factory=list)
    counts: dict[int, int] = field(default_factory=lambda: defaultdict(int))
    start_ns: int = 0
    end_ns: int = 0

    def write(self, out: BinaryIO) -> None:
        """Write data end, summary and footer."""
        from mcap import records
        from mcap.opcode import Opcode

        out.write(mcap.encode(records.DataEnd(0)))
        statistics = records.Statistics(
            attachment_count=len(self.attachments),
            channel_count=len(self.channels),
            channel_message_counts=dict(self.counts),
            chunk_count=len(self.chunks),
            message_count=sum(self.counts.values()),
            metadata_count=len(self.metadata),
            message_start_time=self.start_ns,
            message_end_time=self.end_ns,
            schema_count=len(self.schemas),
        )
        groups = (
            (Opcode.SCHEMA, self.schemas),
            (Opcode.CHANNEL, self.channels),
            (Opcode.STATISTICS, [statistics]),
            (Opcode.CHUNK_INDEX, self.chunks),
            (Opcode.ATTACHMENT_INDEX, self.attachments),
            (Opcode.METADATA_INDEX, self.metadata),
        )
        start = out.tell()
        body, offsets = b"", []
        for opcode, some in groups:
            if some:
                part = mcap.encode(*some)
                offsets.append(records.SummaryOffset(opcode, start + len(body), len(part)))
                body += part
        offsets_at = start + len(body)
        body += mcap.encode(*offsets)
        head = struct.pack("<BQQQ", mcap.FOOTER, 8 + 8 + 4, start, offsets_at)
        crc = zlib.crc32(head, zlib.crc32(body))
        out.write(body + mcap.encode(records.Footer(start, offsets_at, crc)) + mcap.MAGIC)
