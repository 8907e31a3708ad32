"""A lock-free ring in shared memory: one writer that never blocks, any number of readers that count misses.

One file in ``/dev/shm`` (mode 0600) holds two rings of fixed slots: ticks
(`contid.control.engine.tick_layout`) and events (JSON). The writer stamps a slot with 0, fills it, stamps it
with its sequence number (from 1) and moves the head; a reader copies a slot and compares the stamp again, so
an overwritten slot is detected and counted. A long event takes several slots. Readers attach by path, and
their mapping stays valid after the file is unlinked.

Layout of the file: 64 bytes of header (magic, sizes, closed flag, two sequence numbers), the JSON of the
`RecordLayout`, tick slots, event slots. Every slot has a CRC-32 of its contents and number: processors other
than x86-64 may show a reader the stamp before the contents, and such a slot is read again. The sequence
numbers are stored in one piece: `struct` clears the bytes before it packs, and a reader would see zero.
"""

from __future__ import annotations

import errno
import fcntl
import json
import mmap
import os
import secrets
import struct
import tempfile
import time
import zlib
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from contid.control.engine.events.base import RunEvent
from contid.control.engine.events.gaps import EventTooLong
from contid.control.engine.events.json_form import from_json, to_json
from contid.control.engine.tick_layout import LATENESS, RecordLayout, TickRecord
from contid.errors import ContidError

MAGIC: Final = b"contidR5"
HEAD: Final = struct.Struct("=8sQQQQQ")  # magic, bytes of JSON, tick slots, bytes per tick, event slots
HEAD_BYTES: Final = 64
#: Places of the closed flag and of the two sequence numbers, in integers of 8 bytes.
CLOSED, TICKS, EVENTS = 5, 6, 7
#: Size of an event slot, and number of them.
EVENT_BYTES: Final = 2048
EVENT_SLOTS: Final = 1024
#: Most slots of one event, so that a timely reader gets all of them.
EVENT_PARTS: Final = 128
#: Least time of ticks that a ring holds [s].
SECONDS: Final = 8.0
#: A younger ring may belong to a run that has not opened it yet.
STALE_S: Final = 60.0
#: Files of arrays sent to the control process (`contid.control.process.pipe.BulkMessage`).
BULK_FILES: Final = "contid-*.bulk"
#: Trajectories for the recorder (`contid.session.recording_observer`).
ATTACHED_FILES: Final = "contid-*.npz"
U64: Final = struct.Struct("=Q")
F64: Final = struct.Struct("=d")
STAMP: Final = struct.Struct("=QI")  # sequence number, CRC-32 of contents and number
PART: Final = struct.Struct("=IHH")  # bytes of this part of an event, parts before it, parts after it
#: Times that a slot is read before a wrong CRC counts.
TRIES: Final = 4


class RingError(ContidError):
    """A ring cannot be created or attached."""


def folder() -> Path:
    """The folder of rings: shared memory, or the temporary folder on a machine without it."""
    shared = Path("/dev/shm")
    return shared if shared.is_dir() else Path(tempfile.gettempdir())


def sweep() -> None:
    """Remove the rings and array files of killed runs, which no process has open."""
    patterns = ("contid-*.ring", BULK_FILES, ATTACHED_FILES)
    for path in (path for pattern in patterns for path in folder().glob(pattern)):
        with suppress(OSError), path.open("rb") as file:
            if time.time() - os.fstat(file.fileno()).st_mtime > STALE_S:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                path.unlink()


def create(layout: RecordLayout, seconds: float = SECONDS) -> Path:
    """Create the file of a ring that holds at least ``seconds`` of ticks; returns its path.

    The memory is allocated now: with a sparse file, a full folder would end the writer during a motion.

    Raises:
        RingError: no space left, or the folder is not writable.
    """
    text = layout.to_json().encode()
    slots = max(int(seconds * layout.rate_hz), 256)
    size = layout.packer().size + STAMP.size
    total = _events_at(len(text), slots, size) + EVENT_SLOTS * EVENT_BYTES
    path = folder() / f"contid-{os.getpid()}-{secrets.token_hex(4)}.ring"
    try:
        with os.fdopen(os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600), "r+b") as file:
            os.posix_fallocate(file.fileno(), 0, total)
            file.write(HEAD.pack(MAGIC, len(text), slots, size, EVENT_SLOTS, 0))
            file.seek(HEAD_BYTES)
            file.write(text)
    except OSError as error:
        path.unlink(missing_ok=True)
        if error.errno in (errno.EMFILE, errno.ENFILE):
            raise  # not a matter of memory: the command names the limit of open files
        message = f"{path.parent}: no shared memory of {total / 1e6:.1f} MB for this run: {error.strerror}"
        raise RingError(f"{message}; remove files from it, or enlarge it (docker: --shm-size)") from error
    return path


def _slots_at(text_bytes: int) -> int:
    return (HEAD_BYTES + text_bytes + 63) // 64 * 64


def _events_at(text_bytes: int, slots: int, size: int) -> int:
    return _slots_at(text_bytes) + slots * size


class _Mapped:
    """The mapped file and its layout."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._file = path.open("r+b")
        except OSError as error:
            raise RingError(f"{path}: no ring to attach to ({error}); is the daemon running?") from error
        with ExitStack() as undo:
            undo.callback(self._file.close)
            # Every process that has the ring open shares this lock; `sweep` tries to get it exclusively.
            fcntl.flock(self._file, fcntl.LOCK_SH)
            self._map = mmap.mmap(self._file.fileno(), 0)
            undo.callback(self._map.close)
            magic, text_bytes, self.slots, self.size, self.event_slots, _ = HEAD.unpack_from(self._map)
            if magic != MAGIC:
                raise RingError(f"{path}: not a ring of this version of contid")
            self.layout = RecordLayout.from_json(self._map[HEAD_BYTES : HEAD_BYTES + text_bytes].decode())
            undo.pop_all()
        self._numbers = memoryview(self._map)[:HEAD_BYTES].cast("Q")
        self._ticks_at = _slots_at(text_bytes)
        self._events_at = _events_at(text_bytes, self.slots, self.size)
        self._packer = self.layout.packer()

    def close(self) -> None:
        """Unmap and close; idempotent."""
        self._numbers.release()
        self._map.close()
        self._file.close()


class RingWriter(_Mapped):
    """The writer."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._ticks = 0
        self._events = 0

    def write(self, values: list[float]) -> None:
        """Publish one tick: all values of the layout in order."""
        number = self._ticks
        at = self._ticks_at + number % self.slots * self.size
        self._ticks = number + 1
        self._fill(at, self._ticks, self._packer.pack(*values))
        self._numbers[TICKS] = self._ticks

    def event(self, event: RunEvent) -> None:
        """Publish one event; beyond `EVENT_PARTS` slots its longest text is cut or ``too_long`` sent."""
        body = json.dumps(to_json(event)).encode()
        room = EVENT_BYTES - STAMP.size - PART.size
        if len(body) > room * EVENT_PARTS:
            body = _shortened(to_json(event), room * EVENT_PARTS)
        parts = [body[start : start + room] for start in range(0, len(body), room)]
        for index, part in enumerate(parts):
            self._part(part, index, len(parts) - 1 - index)

    def _part(self, body: bytes, before: int, after: int) -> None:
        number = self._events
        at = self._events_at + number % self.event_slots * EVENT_BYTES
        self._events = number + 1
        self._fill(at, self._events, PART.pack(len(body), before, after) + body)
        self._numbers[EVENTS] = self._events

    def _fill(self, at: int, number: int, contents: bytes) -> None:
        """Fill a slot; its stamp comes last."""
        STAMP.pack_into(self._map, at, 0, _crc(number, contents))
        self._map[at + STAMP.size : at + STAMP.size + len(contents)] = contents
        U64.pack_into(self._map, at, number)

    def finish(self) -> None:
        """Mark the ring as complete."""
        self._numbers[CLOSED] = 1


def _crc(number: int, contents: bytes) -> int:
    return zlib.crc32(contents, number & 0xFFFFFFFF)


def _shortened(event: Mapping[str, Any], limit: int) -> bytes:
    """The JSON of an event within ``limit`` bytes: its longest text cut, or the event ``too_long``."""
    texts = {key: value for key, value in event.items() if isinstance(value, str) and key != "event"}
    longest = max(texts, key=lambda key: len(texts[key]), default=None)
    if longest is not None:
        # A character takes at most twelve bytes, as two escapes.
        others = len(json.dumps({**event, longest: "..."}))
        kept = texts[longest][: max(limit - others, 0) // 12] + "..."
        body = json.dumps({**event, longest: kept}).encode()
        if len(body) <= limit:
            return body
    return json.dumps(to_json(EventTooLong(kind=event["event"]))).encode()


@dataclass(slots=True)
class _Cursor:
    """Number of the next slot to read, and count of slots overwritten before."""

    next: int = 0
    missed: int = 0


class RingReader(_Mapped):
    """A reader with its own position."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._tick = _Cursor()
        self._event = _Cursor()
        self._parts: list[bytes] = []

    @property
    def missed_ticks(self) -> int:
        """Records overwritten before they were read."""
        return self._tick.missed

    @property
    def missed_events(self) -> int:
        """Event slots overwritten before they were read."""
        return self._event.missed

    @property
    def finished(self) -> bool:
        """True when the writer has finished; its records can still be read."""
        return bool(self._numbers[CLOSED])

    @property
    def written(self) -> int:
        """Records written so far."""
        return self._numbers[TICKS]

    def skip(self) -> int:
        """Go on with the next record and the next event; returns the number of records left out."""
        self._event = _Cursor(self._numbers[EVENTS])
        self._tick = _Cursor(self.written)
        return self._tick.next

    def rewind(self) -> None:
        """Go back to the oldest record in the ring."""
        self._tick = _Cursor(max(self.written - self.slots + 1, 0))

    def ticks(self, at_most: int = 1 << 30) -> list[TickRecord]:
        """Unread records, oldest first."""
        return [self.layout.decode(values) for values in self.raw_ticks(at_most)]

    def raw_ticks(self, at_most: int = 1 << 30) -> list[tuple[float, ...]]:
        """The undecoded values of unread records, oldest first."""
        out: list[tuple[float, ...]] = []
        while len(out) < at_most and (raw := self._next(self._tick, TICKS, self.slots, self._tick_slot)):
            out.append(self._packer.unpack(raw))
        return out

    def newest(self) -> TickRecord | None:
        """The newest record, without moving the position."""
        for _ in range(3):
            number = self.written
            if number == 0:
                return None
            if raw := self._contents(number, self._tick_slot):
                return self.layout.decode(self._packer.unpack(raw))
        return None

    def lateness(self, ticks: int) -> list[float]:
        """How late the newest ticks started [s], without moving the position."""
        written = self.written
        newest = range(max(written - min(ticks, self.slots - 1), 0), written)
        at = STAMP.size + LATENESS * F64.size
        return [F64.unpack_from(self._tick_slot(number), at)[0] for number in newest]

    def events(self) -> list[RunEvent]:
        """Unread events, oldest first; an event with overwritten parts is dropped."""
        out: list[RunEvent] = []
        missed = self._event.missed
        while raw := self._next(self._event, EVENTS, self.event_slots, self._event_slot):
            _, before, after = PART.unpack_from(raw)
            if before == 0 or self._event.missed != missed:
                self._parts.clear()
                missed = self._event.missed
            if before != len(self._parts):
                continue  # rest of an event whose first part was overwritten
            self._parts.append(raw[PART.size :])
            if after == 0:
                out.append(from_json(json.loads(b"".join(self._parts))))
        return out

    def _tick_slot(self, number: int) -> bytes:
        at = self._ticks_at + number % self.slots * self.size
        return self._map[at : at + self.size]

    def _event_slot(self, number: int) -> bytes:
        at = self._events_at + number % self.event_slots * EVENT_BYTES
        length = PART.unpack_from(self._map, at + STAMP.size)[0]
        return self._map[at : at + min(STAMP.size + PART.size + length, EVENT_BYTES)]

    def _contents(self, stamp: int, slot: Callable[[int], bytes]) -> bytes | None:
        """The contents of the slot with a stamp; None when it was overwritten, or is not all visible yet."""
        for _ in range(TRIES):
            raw = slot(stamp - 1)
            found, crc = STAMP.unpack_from(raw)
            contents = raw[STAMP.size :]
            if found != stamp:
                return None
            if crc == _crc(stamp, contents):
                return contents
        return None

    def _next(
        self, cursor: _Cursor, head_place: int, slots: int, slot: Callable[[int], bytes]
    ) -> bytes | None:
        """Copy the next slot; skip and count those that were overwritten or never became whole."""
        while True:
            head = self._numbers[head_place]
            if cursor.next >= head:
                return None
            oldest = head - slots + 1  # the slot after the newest may be being written
            if cursor.next < oldest:
                cursor.missed += oldest - cursor.next
                cursor.next = oldest
            number = cursor.next
            if contents := self._contents(number + 1, slot):
                cursor.next = number + 1
                return contents
            if number + 1 == head:
                return None  # its contents may become visible
            if int(U64.unpack_from(slot(number))[0]) == number + 1:
                cursor.missed += 1
                cursor.next = number + 1
