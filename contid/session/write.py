"""Recording: MCAP with one uncompressed chunk per write, every tick in one write to the operating system.

Every chunk has the CRC-32 of its messages, the metadata ``checksum`` that of everything before them, and the
end of the data that of the whole file: no flipped bit is read as a measurement. Written data survive the
end of this process; a power cut loses what came after the last `SessionWriter.sync`. A clean end adds the
footer, and `contid_sessions.compact` compresses the file. Until then the file is locked: it can be read, but
not repaired. Files of recordings are private, and never overwritten.
"""

from __future__ import annotations

import fcntl
import json
import os
import zlib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from contid.control.engine.events import RunEvent
from contid.control.engine.events.json_form import to_json
from contid.control.engine.tick_layout import DEADLINE, TICK
from contid.entry_points import RECORDINGS, load_one
from contid.errors import ContidError, RecordingStoppedError
from contid.session.format import mcap_records as mcap
from contid.session.format.channels import CHANNELS, EVENT, schema
from contid.session.format.encode import Encoder
from contid.session.format.header import Header
from contid.whole_file import sync_folder

#: Sessions and command logs hold everything a robot did: for their owner only.
PRIVATE: Final = 0o600
#: Bytes collected before a write in virtual time, where no reader follows the file.
_BUFFER_BYTES: Final = 1 << 20
#: Of a recording that has another name now.
MOVED: Final = "it was moved meanwhile; `contid session repair` compacts it where it is"
_EVENT_ID: Final = CHANNELS.index(EVENT) + 1


def compact(path: Path, written: os.stat_result) -> None:
    """Compress and index a complete session in its place; without the extra `sessions` it stays as it is.

    Args:
        path: where it was begun.
        written: status of the file that was written there; another one, of a later run, stays untouched.

    Raises:
        ContidError: it cannot be written, or it was moved; both files are unchanged.
    """
    if not path.exists() or not os.path.samestat(path.stat(), written):
        raise ContidError(f"{path}: {MOVED}")
    compacted = load_one(RECORDINGS, "compact")
    if compacted is not None:
        compacted(path)


def exists_error(path: Path) -> ContidError:
    """The error for a recording that would be overwritten."""
    return ContidError(f"{path}: file exists; recordings are never overwritten")


class SessionWriter:
    """Writes one session; a `contid.control.engine.cycle.Sink` of a run in virtual time.

    Attributes:
        path: where it was begun.
        status: of the file, by which it is known when it is moved.
    """

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
        self.status = os.fstat(self._file)
        with suppress(OSError):  # a file system without locks
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        #: Messages since the last write, and the time of the first of them.
        self._messages = bytearray()
        self._messages_ns = self._time_ns
        self._crc = 0  # of everything written
        head = mcap.MAGIC + head_records(header)
        try:
            self._append(head + mcap.checksum(zlib.crc32(head)))
            with suppress(OSError):  # a file system that has no such call for folders
                sync_folder(path.parent)
        except RecordingStoppedError as error:
            self.close()
            path.unlink(missing_ok=True)
            raise ContidError(str(error)) from None  # nothing was recorded

    @property
    def pending(self) -> int:
        """Bytes not yet written."""
        return len(self._messages)

    def tick(self, values: Sequence[float]) -> None:
        """Add a tick: the values of a record in order, integers as integers."""
        tick, time_ns = int(values[TICK]), self._header.time_ns(values[DEADLINE])
        if not self._messages:
            self._messages_ns = time_ns
        self._time_ns, self._sequence = time_ns, tick
        for number, data in enumerate(self._encoder.encode(values), 1):
            self._messages += mcap.message(number, tick, time_ns, data)

    def write(self, values: Sequence[float]) -> None:
        """Add a tick of a run in virtual time, with its numbers as a ring would return them."""
        self.tick(self._packer.unpack(self._packer.pack(*values)))
        if self.pending > _BUFFER_BYTES:
            self.flush()

    def event(self, event: RunEvent) -> None:
        """Add an event at the time of the newest tick."""
        data = json.dumps(to_json(event), separators=(",", ":")).encode()
        self._messages += mcap.message(_EVENT_ID, self._sequence, self._time_ns, data)

    def attach(self, name: str, media: str, data: bytes, metadata: Mapping[str, str]) -> None:
        """Write a file and its metadata.

        Raises:
            RecordingStoppedError: the disk is full or disconnected.
        """
        from mcap.records import Attachment, Metadata

        self.flush()
        data = mcap.encode(
            Metadata(name=name, metadata=dict(metadata)),
            Attachment(self._time_ns, self._time_ns, f"{name}.npz", media, data),
        )
        self._append(data + mcap.checksum(zlib.crc32(data, self._crc)))

    def flush(self) -> None:
        """Write what is pending to the file, in one piece.

        Raises:
            RecordingStoppedError: the disk is full or disconnected.
        """
        if self._messages:
            chunk = mcap.plain_chunk(self._messages, self._messages_ns, self._time_ns)
            self._messages.clear()
            self._append(chunk)
        self._messages_ns = self._time_ns

    def sync(self) -> None:
        """Wait until everything written is on the disk; may be called from another thread.

        Raises:
            RecordingStoppedError: the disk has failed, or the file was deleted.
        """
        try:
            self._require_kept()
            os.fdatasync(self._file)
        except OSError as error:
            raise RecordingStoppedError(f"{self.path}: recording stopped: {error.strerror}") from error

    def _append(self, data: bytes) -> None:
        self._crc = zlib.crc32(data, self._crc)
        view = memoryview(data)
        try:
            done = 0
            while done < len(view):
                done += os.write(self._file, view[done:])
        except OSError as error:
            raise RecordingStoppedError(f"{self.path}: recording stopped: {error.strerror}") from error

    def finish(self) -> None:
        """End the file as MCAP requires, without an index."""
        from mcap.records import DataEnd, Footer

        self.flush()
        self._append(mcap.encode(DataEnd(self._crc), Footer(0, 0, 0)) + mcap.MAGIC)
        self._require_kept()
        self.close()

    def _require_kept(self) -> None:
        """Refuse to go on when the file was deleted: without a name it is gone when it is closed."""
        if os.fstat(self._file).st_nlink < self.status.st_nlink:
            raise RecordingStoppedError(f"{self.path}: recording stopped: the file was deleted")

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
