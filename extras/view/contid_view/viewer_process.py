"""The viewer's process: reads the ring and draws; no other process waits for it.

Started as ``python -m contid_view.viewer_process`` with a pickled `ViewerJob` on stdin, at a lower priority
than the processes that move the robot; the only one of a run that imports Rerun. Ticks that it misses are
counted. It ends when the ring is finished or the ring's writer has ended.
"""

from __future__ import annotations

import os
import pickle
import select
import signal
import sys
from contextlib import closing
from typing import Final

from contid.control.engine.events.buses import ViewerPaused
from contid.control.process.ring_reader import RingReader
from contid.errors import ContidError
from contid_view.frames import BATCH, FRAMES_HZ, Decimator
from contid_view.view_target import Kind, ViewerJob

NICE: Final = 10


class Viewer:
    """Draws the records of a ring."""

    def __init__(self, job: ViewerJob, reader: RingReader) -> None:
        from contid_view.rerun.session import RerunSession  # after `main` has set priority and RUST_LOG

        self._reader = reader
        self._missed = 0
        try:
            self._pidfd = os.pidfd_open(job.pid)
        except ProcessLookupError:
            self._pidfd = -1
        self._session = RerunSession(job.target, job.loaded, job.rate_hz, live=True)
        self._writer = self._session.writer
        batch = BATCH if job.target.kind is Kind.FILE else 1
        self._decimator = Decimator(reader.layout, self._writer.write, batch)
        if self._session.server is not None:
            sys.stderr.write(f"contid: view: {self._session.server.url}\n")

    def run(self) -> None:
        """Draw until the ring is finished, the control process has ended, or the window is closed."""
        writer_ended = self._pidfd < 0
        while True:
            finished = self._reader.finished
            self._draw_new()
            if finished or writer_ended:
                break
            if self._session.window is not None and not self._session.window.open:
                sys.stderr.write("contid: view: the window was closed; the run goes on\n")
                return
            writer_ended = bool(select.select([self._pidfd], [], [], 1.0 / FRAMES_HZ)[0])
        self._decimator.finish()

    def close(self) -> None:
        """End the drawing."""
        self._session.close()
        if self._pidfd >= 0:
            os.close(self._pidfd)

    def _draw_new(self) -> None:
        """Draw what is new in the ring."""
        events = self._reader.events()
        for values in self._reader.raw_ticks(1 << 30):
            self._decimator.add(values)
        for event in events:
            self._writer.event(event)
        missed = self._reader.missed_ticks
        if missed != self._missed:
            message = f"the viewer missed {missed - self._missed} ticks"
            self._writer.event(ViewerPaused(message=message))
            self._missed = missed


def main() -> int:
    """Run the viewer's process."""
    # A terminal sends Ctrl-C to the whole process group; the daemon decides how the run ends.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Not relative: the daemon that started it may run at a negative value.
    os.setpriority(os.PRIO_PROCESS, 0, max(os.getpriority(os.PRIO_PROCESS, 0), NICE))
    # A tick on the same core preempts it at once; it draws with the time that nothing else needs.
    os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    os.environ.setdefault("RUST_LOG", "off")  # Rerun logs an error when its window is closed
    job = pickle.load(sys.stdin.buffer)  # from the daemon, the only other end of this pipe
    assert isinstance(job, ViewerJob)
    try:
        with closing(RingReader(job.ring)) as reader, closing(Viewer(job, reader)) as viewer:
            viewer.run()
    except ContidError as error:
        sys.stderr.write(f"contid: view: {error}\n")
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
