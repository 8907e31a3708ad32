"""The file of a lock-free ring in shared memory: one writer that never blocks, any number of readers.

One file in ``/dev/shm`` (mode 0600) holds two rings of fixed slots: ticks
(`contid.control.engine.tick_layout`) and events (JSON). The writer stamps a slot with 0, fills it, stamps it
with its sequence number (from 1) and moves the head; a reader copies a slot and compares the stamp again, so
an overwritten slot is detected and counted. A long event takes several slots. Readers attach by path, and
their mapping stays valid after the file is unlinked.

Layout of the file: 128 bytes of header (magic, sizes, flags, two sequence numbers), the JSON of the
`RecordLayout`, the mean duration of a tick of each robot, tick slots, event slots. Every slot has a CRC-32 of
its contents and number: processors other than x86-64 may show a reader the stamp before the contents, and
such a slot is read again. The sequence numbers are stored in one piece: `struct` clears the bytes before it
packs, and a reader would see zero.
"""

from __future__ import annotations

import errno
import fcntl
import mmap
import os
import secrets
import struct
from contextlib import ExitStack
from pathlib import Path
from typing import Final

from contid.control.engine.tick_layout import RecordLayout
from contid.control.process.shared_files import folder
from contid.errors import ContidError

MAGIC: Final = b"contidR8"
HEAD: Final = struct.Struct("=8sQQQQQ")  # magic, bytes of JSON, tick slots, bytes per tick, event slots
HEAD_BYTES: Final = 128
#: Places of the closed flag, of the two sequence numbers, of the flag of a request to devices that is
#: under way, of the number of the robot whose model computes (from 1), and of the count of the looks of the
#: daemon, in integers of 8 bytes.
CLOSED, TICKS, EVENTS, PREPARING, ROBOT, LOOKS = 5, 6, 7, 8, 9, 10
#: Size of an event slot, and number of them.
EVENT_BYTES: Final = 2048
EVENT_SLOTS: Final = 1024
#: Most slots of one event, so that a timely reader gets all of them.
EVENT_PARTS: Final = 128
#: Least time of ticks that a ring holds [s].
SECONDS: Final = 8.0
U64: Final = struct.Struct("=Q")
F64: Final = struct.Struct("=d")
STAMP: Final = struct.Struct("=QI")  # sequence number, CRC-32 of contents and number
#: Ticks published before an event; bytes of this part of it, parts before it, parts after it.
PART: Final = struct.Struct("=QIHH")
#: Times that a slot is read before a wrong CRC counts.
TRIES: Final = 4


class RingError(ContidError):
    """A ring cannot be created or attached."""


def create(layout: RecordLayout, seconds: float = SECONDS) -> Path:
    """Create the file of a ring that holds at least ``seconds`` of ticks; returns its path.

    The memory is allocated now: with a sparse file, a full folder would end the writer during a motion.

    Raises:
        RingError: no space left, or the folder is not writable.
    """
    text = layout.to_json().encode()
    slots = max(int(seconds * layout.rate_hz), 256)
    size = layout.packer().size + STAMP.size
    total = _slots_at(len(text), len(layout.robots)) + slots * size + EVENT_SLOTS * EVENT_BYTES
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
        remedy = "remove files from it, or enlarge it (docker: --shm-size)"
        if error.errno in (errno.EROFS, errno.EACCES, errno.EPERM):
            remedy = f"mount a tmpfs there that you can write (docker: --tmpfs {path.parent})"
        raise RingError(f"{message}; {remedy}") from error
    return path


def _costs_at(text_bytes: int) -> int:
    return (HEAD_BYTES + text_bytes + 63) // 64 * 64


def _slots_at(text_bytes: int, robots: int) -> int:
    return _costs_at(text_bytes) + robots * F64.size


class MappedRing:
    """The mapped file and its layout; base of writer and readers."""

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
        self._ticks_at = _slots_at(text_bytes, len(self.layout.robots))
        self._events_at = self._ticks_at + self.slots * self.size
        self._costs = memoryview(self._map)[_costs_at(text_bytes) : self._ticks_at].cast("d")
        self._packer = self.layout.packer()

    def close(self) -> None:
        """Unmap and close; idempotent."""
        self._numbers.release()
        self._costs.release()
        self._map.close()
        self._file.close()
