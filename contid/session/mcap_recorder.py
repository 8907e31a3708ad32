"""The recorder's process: reads the ring, writes every tick through, outlives the daemon.

Started before the first tick as ``python -m contid.session.mcap_recorder``; its `RecorderJob` comes pickled
on stdin, its answers go as lines to stdout: ``ready`` or what is wrong, later what went wrong. It sleeps
until half a period after the next deadline, which it knows from the newest record, with the writer's pidfd
in the same ``select``: one wake-up per tick, no spinning, and nothing to do for the control process.

It ends when the ring is finished or its writer is gone, whatever became of the daemon: drains, adds the
footer, compacts. SIGTERM and SIGINT are ignored for that reason (a service manager sends them to everyone).
"""

from __future__ import annotations

import gc
import json
import os
import pickle
import select
import signal
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Final

from contid.control.engine.tick_layout import DEADLINE
from contid.control.process.ring import RingReader
from contid.errors import ContidError
from contid.session.compact import compact
from contid.session.format.header import NPZ, Attached, RecorderJob
from contid.session.write import SessionWriter

READY: Final = "ready"
#: Records taken from the ring before they are written: what bounds the memory after a long stop of the disk.
_AT_ONCE: Final = 256
#: Share of a period after a deadline at which its record is fetched.
_AFTER: Final = 0.5
_SHORTEST_S: Final = 5e-4
#: Nice value while recording: what is in the ring only is what a kill of this process loses.
_PRIORITY: Final = -10


class McapRecorder:
    """From a ring to a file."""

    def __init__(self, job: RecorderJob) -> None:
        self._reader = RingReader(job.ring)
        try:
            self._writer = SessionWriter(job.path, job.header)
        except BaseException:
            self._reader.close()
            raise
        self._period_s = 1.0 / job.header.layout.rate_hz
        self._next_s = 0.0
        self._taken = 0
        self._missed = (0, 0)
        self._inbox = -1
        self._lines = b""
        try:
            self._pidfd = os.pidfd_open(job.pid)
        except ProcessLookupError:
            self._pidfd = -1

    def run(self) -> None:
        """Until the writer is done.

        Raises:
            ContidError: the file cannot be written any more.
        """
        gone = self._pidfd < 0
        while True:
            # Asked before the ring is emptied: what was written until then is read below.
            finished = self._reader.finished
            while self._drain():
                pass
            if finished or gone:
                break
            gone = self._sleep()
        if not finished:
            self._writer.event({"event": "recorder", "message": "the control process ended without a word"})
        self._writer.finish()

    def listen(self, descriptor: int) -> None:
        """Take trajectories that come during the run from the daemon's pipe."""
        os.set_blocking(descriptor, False)
        self._inbox = descriptor

    def close(self) -> None:
        """Let file and ring go."""
        self._writer.close()
        self._reader.close()
        if self._pidfd >= 0:
            os.close(self._pidfd)

    def _drain(self) -> bool:
        """Write what is new, at most `_AT_ONCE` ticks; True when there may be more."""
        reader, writer = self._reader, self._writer
        written = reader.written
        if self._inbox >= 0:
            self._take_attached()  # sent here before its order was sent, so it is here when its event is
        # Events of a tick are in the ring before its record: fetched in this order, they are in the file too.
        for event in reader.events():
            writer.event(event)
        wanted = min(written - self._taken, _AT_ONCE)
        raw = reader.raw_ticks(wanted) if wanted > 0 else []
        missed = (reader.missed_ticks, reader.missed_events)
        if missed != self._missed:
            ticks, events = missed[0] - self._missed[0], missed[1] - self._missed[1]
            writer.event({"event": "overrun", "missed_ticks": ticks, "missed_events": events})
            self._taken += ticks
            self._missed = missed
        for values in raw:
            writer.tick(values)
        if raw:
            self._taken += len(raw)
            self._next_s = raw[-1][DEADLINE] + (1.0 + _AFTER) * self._period_s
        if writer.pending:
            writer.flush()
        return self._taken < written

    def _take_attached(self) -> None:
        try:
            chunk = os.read(self._inbox, 1 << 16)
        except BlockingIOError:
            return
        if not chunk:  # the daemon is gone, or has nothing more to say
            self._inbox = -1
            return
        *lines, self._lines = (self._lines + chunk).split(b"\n")
        for line in lines:
            told = Attached(**json.loads(line))
            path = Path(told.path)
            with suppress(OSError):
                self._writer.attach(told.name, NPZ, path.read_bytes(), told.about)
                path.unlink()

    def _sleep(self) -> bool:
        """Until the next record should be there; True when its writer is gone."""
        wait_s = self._next_s - time.monotonic()
        if wait_s <= 0.0:  # it is late: connecting, or a skipped tick
            wait_s = max(_AFTER * self._period_s, _SHORTEST_S)
        ready, _, _ = select.select([self._pidfd], [], [], min(wait_s, 0.1))
        return bool(ready)


def main() -> int:
    """Run the recorder's process."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    daemon = os.getppid()
    job = pickle.load(sys.stdin.buffer)  # from the daemon that started this process, nobody else has the pipe
    assert isinstance(job, RecorderJob)
    try:
        recorder = McapRecorder(job)
    except ContidError as error:
        _answer(str(error))
        return error.exit_code
    _answer(READY)
    gc.collect()
    gc.freeze()
    _ask_for(_PRIORITY)
    recorder.listen(sys.stdin.fileno())
    try:
        recorder.run()
    except ContidError as error:
        _answer(str(error))
        sys.stderr.write(f"contid: {error}\n")
        return error.exit_code
    finally:
        recorder.close()
    _ask_for(-_PRIORITY)  # making the file small may take as long as it likes
    if os.getppid() != daemon:  # nobody else is left to clean up
        job.ring.unlink(missing_ok=True)
    try:
        compact(job.path)
    except ContidError as error:
        _answer(f"complete, but not compacted: {error}")
    return 0


def _ask_for(nice: int) -> None:
    """Come sooner, or later, than others; without the right to it, as everybody."""
    with suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, nice)


def _answer(message: str) -> None:
    """A line for the daemon, if it still lives."""
    with suppress(OSError):
        os.write(1, (message.replace("\n", " ") + "\n").encode())


if __name__ == "__main__":
    sys.exit(main())
