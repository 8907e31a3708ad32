"""The recorder's process: reads the ring, writes every tick at once, outlives the daemon.

Started before the first tick as ``python -m contid.session.mcap_recorder`` with a pickled `RecorderJob` on
stdin. Its stdout has lines for the daemon: ``ready`` or an error, later `MISSED` with the number of ticks
that it missed so far, or further errors. A thread brings what was written to the disk every `SYNC_PERIOD_S`.
The recorder sleeps until half a period after the next deadline, computed from the newest record, with the
pidfd of the ring's writer (the control process) in the same ``select``: one wake-up per tick, and no work for
the control process. It sleeps `_MAX_SLEEP_S` at most.

It ends when the ring is finished or the ring's writer has ended, with or without the daemon, or when the
daemon ends a recording that began during the run: drains the ring, adds the footer, compacts. It ignores
SIGTERM, SIGINT and SIGHUP, which service managers send to the whole group.
"""

from __future__ import annotations

import gc
import json
import os
import pickle
import select
import signal
import sys
import threading
import time
from collections import deque
from contextlib import suppress
from pathlib import Path
from typing import Final

from contid.control.engine.events.buses import RecorderFailed, RecorderOverrun
from contid.control.engine.tick_layout import DEADLINE
from contid.control.process.ring_reader import DatedEvent, RingReader
from contid.errors import ContidError
from contid.session.format.header import END, NPZ, Attached, RecorderJob
from contid.session.write import SessionWriter, compact

READY: Final = "ready"
#: Begin of a line with the number of ticks that are missing in the file, because the disk was too slow.
MISSED: Final = "missed "
#: Time between two calls that bring what was written to the disk: at most this much is lost at a power cut.
SYNC_PERIOD_S: Final = 0.8
#: Records read from the ring before they are written; limits the memory after a long stall of the disk.
_MAX_RECORDS: Final = 256
#: Fraction of a period after a deadline at which its record is read.
_DELAY: Final = 0.5
_MIN_SLEEP_S: Final = 5e-4  # while a record is overdue
#: Longest sleep: the end of the ring, lines of the daemon and an error of the disk do not wake the recorder.
_MAX_SLEEP_S: Final = 0.1
#: Nice values: records that are not read in time are missing, a file that is compacted later is not.
_NICE_RECORDING: Final = -10
_NICE_COMPACTING: Final = 10


class McapRecorder:
    """Writes the records of a ring to a file; raises `ContidError` where it cannot create it.

    Attributes:
        status: of the file, as of `SessionWriter`.
    """

    def __init__(self, job: RecorderJob) -> None:
        self._reader = RingReader(job.ring)
        try:
            self._writer = SessionWriter(job.path, job.header)
        except BaseException:
            self._reader.close()
            raise
        self.status = self._writer.status
        self._period_s = 1.0 / job.header.layout.rate_hz
        self._next_s = 0.0
        self._taken = self._reader.skip() if job.during_run else 0
        self._ended = False
        self._missed = (0, 0)  # ticks and events, as far as the file states it
        #: Events of ticks that are not written yet.
        self._events: deque[DatedEvent] = deque()
        self._sync_error: ContidError | None = None
        self._closing = threading.Event()
        self._inbox = -1
        self._lines = b""
        try:
            self._pidfd = os.pidfd_open(job.pid)
        except ProcessLookupError:
            self._pidfd = -1

    def run(self) -> None:
        """Record until the ring is finished, the control process, its writer, has ended, or an order ends it.

        Raises:
            ContidError: the file cannot be written.
        """
        writer_ended = self._pidfd < 0
        # A thread: a disk that takes seconds for it must not keep the ring from being read.
        threading.Thread(target=self._sync, daemon=True).start()
        while True:
            if self._sync_error is not None:
                raise self._sync_error
            # Read before the ring is drained: what was written until then is read below.
            finished = self._reader.finished
            while self._drain():
                pass
            if finished or writer_ended or self._ended:
                break
            writer_ended = self._sleep()
        self._write_events(None)
        self._closing.set()
        if not finished and not self._ended:
            self._writer.event(RecorderFailed(message="the control process ended unexpectedly"))
        self._writer.finish()

    def listen(self, descriptor: int) -> None:
        """Take trajectories of the daemon's later orders from its pipe."""
        os.set_blocking(descriptor, False)
        self._inbox = descriptor

    def close(self) -> None:
        """Close file and ring."""
        self._closing.set()
        self._writer.close()
        self._reader.close()
        if self._pidfd >= 0:
            os.close(self._pidfd)

    def _drain(self) -> bool:
        """Write what is new, at most `_MAX_RECORDS` ticks; True if there may be more."""
        reader, writer = self._reader, self._writer
        written = reader.written
        if self._inbox >= 0:
            self._take_attached()  # it was sent before its order, hence before the event of the order
        # The ring has the events of a tick before its record; the file too.
        self._events += reader.dated_events()
        count = min(written - self._taken, _MAX_RECORDS)
        raw = reader.raw_ticks(count) if count > 0 else []
        missed = (reader.missed_ticks, reader.missed_events)
        if missed != self._missed:
            ticks, events = missed[0] - self._missed[0], missed[1] - self._missed[1]
            writer.event(RecorderOverrun(missed_ticks=ticks, missed_events=events))
            self._taken += ticks
            self._missed = missed
            _answer(f"{MISSED}{missed[0]}")
        for values in raw:
            self._write_events(self._taken)
            writer.tick(values)
            self._taken += 1
        if self._taken >= written:
            self._write_events(written)
        if raw:
            self._next_s = raw[-1][DEADLINE] + (1.0 + _DELAY) * self._period_s
        if writer.pending:
            writer.flush()
        return self._taken < written

    def _write_events(self, ticks: int | None) -> None:
        """Write the events before a tick, at the time of the tick that was written last.

        Args:
            ticks: number of ticks before the one that is written next; None for all events.
        """
        while self._events and (ticks is None or self._events[0].ticks <= ticks):
            self._writer.event(self._events.popleft().event)

    def _sync(self) -> None:
        """Bring what was written to the disk, again and again; in a thread of its own."""
        while not self._closing.wait(SYNC_PERIOD_S):
            try:
                self._writer.sync()
            except ContidError as error:
                self._sync_error = error
                return

    def _take_attached(self) -> None:
        """Take the trajectories that the daemon has sent, or the end of the recording."""
        try:
            chunk = os.read(self._inbox, 1 << 16)
        except BlockingIOError:
            return
        if not chunk:  # the daemon has closed the pipe or has ended
            self._inbox = -1
            return
        *lines, self._lines = (self._lines + chunk).split(b"\n")
        for line in lines:
            if line + b"\n" == END:
                self._ended = True
                continue
            attached = Attached(**json.loads(line))
            path = Path(attached.path)
            try:
                rows = path.read_bytes()
            except OSError as error:
                _answer(f"{attached.name}: not recorded, so it cannot be replayed from there: {error}")
                continue
            self._writer.attach(attached.name, NPZ, rows, attached.about)
            with suppress(OSError):
                path.unlink()

    def _sleep(self) -> bool:
        """Sleep until the next record is due; True if the control process has ended."""
        wait_s = self._next_s - time.monotonic()
        if wait_s <= 0.0:  # overdue: the robots are connecting, or a tick was skipped
            wait_s = max(_DELAY * self._period_s, _MIN_SLEEP_S)
        ready, _, _ = select.select([self._pidfd], [], [], min(wait_s, _MAX_SLEEP_S))
        return bool(ready)


def main() -> int:
    """Run the recorder's process."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    daemon = os.getppid()
    job = pickle.load(sys.stdin.buffer)  # from the daemon, the only other end of this pipe
    assert isinstance(job, RecorderJob)
    try:
        recorder = McapRecorder(job)
    except ContidError as error:
        _answer(str(error))
        return error.exit_code
    _answer(READY)
    os.set_blocking(1, False)  # a daemon that stands still must not keep the ring from being read
    gc.collect()
    gc.freeze()
    _set_nice(_NICE_RECORDING)
    recorder.listen(sys.stdin.fileno())
    try:
        recorder.run()
    except ContidError as error:
        _answer(str(error))
        sys.stderr.write(f"contid: {error}\n")
        return error.exit_code
    finally:
        recorder.close()
    _set_nice(_NICE_COMPACTING)
    if os.getppid() != daemon:  # the daemon, which removes the ring, has ended
        job.ring.unlink(missing_ok=True)
    try:
        compact(job.path, recorder.status)
    except ContidError as error:
        _answer(f"complete, but not compacted: {error}")
    return 0


def _set_nice(nice: int) -> None:
    """Set the nice value, if permitted."""
    with suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, nice)


def _answer(message: str) -> None:
    """Write a line for the daemon, if it still runs."""
    with suppress(OSError):
        os.write(1, (message.replace("\n", " ") + "\n").encode())


if __name__ == "__main__":
    sys.exit(main())
