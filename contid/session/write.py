"""A session while it grows: unchunked MCAP, every tick in one write to the operating system.

What the operating system has taken survives any death of this process; a power cut costs what the system had
not yet brought to the disk. A clean end adds the footer, and `contid.session.compact` makes the file small.
Until then the file is locked: readers take what there is, and nobody repairs it.
"""

from __future__ import annotations

import fcntl
import json
import os
import struct
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from contid.control.engine.tick_layout import DEADLINE, TICK
from contid.errors import ContidError
from contid.session.format import mcap_records as mcap
from contid.session.format.channels import CHANNELS, EVENT, schema
from contid.session.format.encode import Encoder
from contid.session.format.header import Header

#: Without anybody who waits for it (virtual time), so much is gathered before a write.
_ENOUGH: Final = 1 << 20
_EVENT_ID: Final = CHANNELS.index(EVENT) + 1


class SessionWriter:
    """Writes one session."""

    def __init__(self, path: Path, header: Header) -> None:
        """Create the file with everything that comes before the first tick.

        Raises:
            ContidError: it exists already (a recording is never overwritten), or cannot be created.
        """
        self.path = path
        self._header = header
        self._encoder = Encoder(header.layout, header.device_units)
        self._time_ns = header.wall_ns
        self._sequence = 0
        try:
            self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
        except FileExistsError:
            raise ContidError(f"{path}: is there already; a recording is never overwritten") from None
        except OSError as error:
            raise ContidError(f"{path}: cannot record: {error.strerror}") from error
        with suppress(OSError):  # a file system without locks
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        self._buffer = bytearray(mcap.MAGIC + head_records(header))
        try:
            self.flush()
        except ContidError:
            self.close()
            path.unlink(missing_ok=True)
            raise

    @property
    def pending(self) -> int:
        """Bytes not yet written."""
        return len(self._buffer)

    def tick(self, values: Sequence[float]) -> None:
        """Add a tick: all values of a record in order, integers as integers."""
        tick, time_ns = int(values[TICK]), self._header.time_ns(values[DEADLINE])
        self._time_ns, self._sequence = time_ns, tick
        for number, data in enumerate(self._encoder.encode(values), 1):
            self._buffer += mcap.message(number, tick, time_ns, data)

    def event(self, event: Mapping[str, Any]) -> None:
        """Add an event; its time is that of the newest tick."""
        data = json.dumps(event, separators=(",", ":")).encode()
        self._buffer += mcap.message(_EVENT_ID, self._sequence, self._time_ns, data)

    def attach(self, name: str, media: str, data: bytes, about: Mapping[str, str]) -> None:
        """Add a file and what is to be known about it."""
        from mcap.records import Attachment, Metadata

        self._buffer += mcap.built(
            Metadata(name=name, metadata=dict(about)),
            Attachment(self._time_ns, self._time_ns, f"{name}.npz", media, data),
        )

    def flush(self) -> None:
        """Hand everything to the operating system.

        Raises:
            ContidError: the disk is full, or gone.
        """
        view = memoryview(self._buffer)
        try:
            done = 0
            while done < len(view):
                done += os.write(self._file, view[done:])
        except OSError as error:
            raise ContidError(f"{self.path}: recording stopped: {error.strerror}") from error
        finally:
            view.release()
        self._buffer.clear()

    def finish(self) -> None:
        """End the file as MCAP demands, without an index."""
        from mcap.records import DataEnd, Footer

        self._buffer += mcap.built(DataEnd(0), Footer(0, 0, 0)) + mcap.MAGIC
        self.flush()
        self.close()

    def close(self) -> None:
        """Let the file go as it is; idempotent."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1


class SessionSink:
    """A session as a sink of an engine in the same process: runs in virtual time."""

    def __init__(self, writer: SessionWriter, layout_packer: struct.Struct) -> None:
        self._writer = writer
        self._packer = layout_packer

    def write(self, values: list[float]) -> None:
        """See `contid.control.engine.cycle.Sink`; the numbers become what they are in a ring."""
        self._writer.tick(self._packer.unpack(self._packer.pack(*values)))
        if self._writer.pending > _ENOUGH:
            self._writer.flush()

    def event(self, kind: str, **fields: Any) -> None:
        """See `contid.control.engine.cycle.Sink`."""
        self._writer.event({"event": kind, **fields})


def head_records(header: Header) -> bytes:
    """Header, metadata, attachments, schemas and channels."""
    from mcap import records

    out: list[Any] = [records.Header("", mcap.LIBRARY)]
    out += [records.Metadata(name=name, metadata=dict(texts)) for name, texts in header.metadata.items()]
    for name, media, data in header.attachments:
        out.append(records.Attachment(header.wall_ns, header.wall_ns, name, media, data))
    for number, channel in enumerate(CHANNELS, 1):
        text = json.dumps(schema(header.layout, header.device_units, channel)).encode()
        about = records.Schema(id=number, name=f"contid.{channel}", encoding="jsonschema", data=text)
        out.append(about)
        out.append(records.Channel(number, channel, "json", {}, number))
    return mcap.built(*out)
