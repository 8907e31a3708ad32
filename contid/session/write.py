"""Recording: unchunked MCAP, every tick in one write to the operating system.

Written data survive the end of this process; a power cut loses what was not yet on the disk. A clean end adds
the footer, and `contid.session.compact` compresses the file. Until then the file is locked: it can be read,
but not repaired. Files of recordings are private, and never overwritten.
"""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from contid.control.engine.events import RunEvent
from contid.control.engine.events.json_form import to_json
from contid.control.engine.tick_layout import DEADLINE, TICK
from contid.errors import ContidError
from contid.session.format import mcap_records as mcap
from contid.session.format.channels import CHANNELS, EVENT, schema
from contid.session.format.encode import Encoder
from contid.session.format.header import Header

#: Sessions and command logs hold everything a robot did: for their owner only.
PRIVATE: Final = 0o600
#: Bytes collected before a write in virtual time, where no reader follows the file.
_BUFFER_BYTES: Final = 1 << 20
_EVENT_ID: Final = CHANNELS.index(EVENT) + 1


def exists_error(path: Path) -> ContidError:
    """The error for a recording that would be overwritten."""
    return ContidError(f"{path}: file exists; recordings are never overwritten")


def refuse_recording(path: Path) -> None:
    """Recordings are never overwritten, by exports neither.

    Raises:
        ContidError: the file is a recording.
    """
    if path.is_file():
        with path.open("rb") as file:
            if file.read(len(mcap.MAGIC)) == mcap.MAGIC:
                raise exists_error(path)


class SessionWriter:
    """Writes one session; a `contid.control.engine.cycle.Sink` of a run in virtual time."""

    def __init__(self, path: Path, header: Header) -> None:
        """Create the file with its head.

        Raises:
            ContidError: it exists, or cannot be created.
        """
        self.path = path
        self._header = header
        self._encoder = Encoder(header.layout, header.device_units)
        self._packer = header.layout.packer()
        self._time_ns = header.wall_ns
        self._sequence = 0
        try:
            self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, PRIVATE)
        except FileExistsError:
            raise exists_error(path) from None
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
        """Add a tick: the values of a record in order, integers as integers."""
        tick, time_ns = int(values[TICK]), self._header.time_ns(values[DEADLINE])
        self._time_ns, self._sequence = time_ns, tick
        for number, data in enumerate(self._encoder.encode(values), 1):
            self._buffer += mcap.message(number, tick, time_ns, data)

    def write(self, values: Sequence[float]) -> None:
        """Add a tick of a run in virtual time, with its numbers as a ring would return them."""
        self.tick(self._packer.unpack(self._packer.pack(*values)))
        if self.pending > _BUFFER_BYTES:
            self.flush()

    def event(self, event: RunEvent) -> None:
        """Add an event at the time of the newest tick."""
        data = json.dumps(to_json(event), separators=(",", ":")).encode()
        self._buffer += mcap.message(_EVENT_ID, self._sequence, self._time_ns, data)

    def attach(self, name: str, media: str, data: bytes, metadata: Mapping[str, str]) -> None:
        """Add a file and its metadata."""
        from mcap.records import Attachment, Metadata

        self._buffer += mcap.encode(
            Metadata(name=name, metadata=dict(metadata)),
            Attachment(self._time_ns, self._time_ns, f"{name}.npz", media, data),
        )

    def flush(self) -> None:
        """Write the buffer to the file.

        Raises:
            ContidError: the disk is full or disconnected.
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
        """End the file as MCAP requires, without an index."""
        from mcap.records import DataEnd, Footer

        self._buffer += mcap.encode(DataEnd(0), Footer(0, 0, 0)) + mcap.MAGIC
        self.flush()
        self.close()

    def close(self) -> None:
        """Close the file as it is; idempotent."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1


def head_records(header: Header) -> bytes:
    """Header, metadata, attachments, schemas and channels."""
    from mcap import records

    out: list[Any] = [records.Header("", mcap.LIBRARY)]
    out += [records.Metadata(name=name, metadata=dict(texts)) for name, texts in header.metadata.items()]
    for name, media, data in header.attachments:
        out.append(records.Attachment(header.wall_ns, header.wall_ns, name, media, data))
    for number, channel in enumerate(CHANNELS, 1):
        text = json.dumps(schema(header.layout, header.device_units, channel)).encode()
        declared = records.Schema(id=number, name=f"contid.{channel}", encoding="jsonschema", data=text)
        out.append(declared)
        out.append(records.Channel(number, channel, "json", {}, number))
    return mcap.encode(*out)
