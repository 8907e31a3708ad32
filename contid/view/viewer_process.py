"""The viewer's process: reads the ring, draws, holds nobody up.

Started as ``python -m contid.view.viewer_process`` with a pickled `ViewerJob` on stdin, at a lower priority
than all that moves. It is the only process of a run that imports Rerun. What it cannot keep up
with is dropped and counted; it ends when the ring is finished or its writer is gone.
"""

from __future__ import annotations

import os
import pickle
import select
import signal
import sys
from typing import Final

from contid.control.process.ring import RingReader
from contid.errors import ContidError
from contid.view.frames import BATCH, FRAMES_HZ, Decimator, Frame
from contid.view.job import ViewerJob
from contid.view.view_target import Kind

NICE: Final = 10


class Viewer:
    """From a ring to a picture."""

    def __init__(self, job: ViewerJob, reader: RingReader) -> None:
        # Here: whoever only wants the job must not pay for Rerun.
        from contid.view.rerun_session import RerunSession
        from contid.view.stage import build_stage

        self._reader = reader
        self._decimator = Decimator(reader.layout)
        self._batch = BATCH if job.where.kind is Kind.FILE else 1
        self._frames: list[Frame] = []
        self._missed = 0
        try:
            self._pidfd = os.pidfd_open(job.pid)
        except ProcessLookupError:
            self._pidfd = -1
        stage = build_stage(job.loaded, job.rate_hz)
        self._host = RerunSession(job.where, job.loaded.file.name, stage, job.rate_hz, live=True)
        self._picture = self._host.picture
        if self._host.server is not None:
            sys.stderr.write(f"contid: view: {self._host.server.url}\n")

    def run(self) -> None:
        """Until the writer is done."""
        gone = self._pidfd < 0
        while True:
            finished = self._reader.finished
            self._look()
            if finished or gone:
                break
            if self._host.window is not None and not self._host.window.open:
                sys.stderr.write("contid: view: the window was closed; the run goes on\n")
                return
            gone = bool(select.select([self._pidfd], [], [], 1.0 / FRAMES_HZ)[0])
        if (frame := self._decimator.rest()) is not None:
            self._frames.append(frame)
        self._draw()

    def close(self) -> None:
        """Let go of everything."""
        self._host.close()
        if self._pidfd >= 0:
            os.close(self._pidfd)

    def _look(self) -> None:
        """Take what is new in the ring."""
        events = self._reader.events()
        for values in self._reader.raw_ticks(1 << 30):
            if (frame := self._decimator.add(values)) is not None:
                self._frames.append(frame)
                if len(self._frames) >= self._batch:
                    self._draw()
        for event in events:
            self._picture.event(event)
        missed = self._reader.missed_ticks
        if missed != self._missed:
            message = f"{missed - self._missed} ticks passed while the viewer stood still"
            self._picture.event({"event": "viewer", "message": message})
            self._missed = missed

    def _draw(self) -> None:
        self._picture.write(self._frames)
        self._frames.clear()


def main() -> int:
    """Run the viewer's process."""
    # A terminal sends Ctrl-C to everyone; the daemon decides what it means.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.nice(NICE)
    os.environ.setdefault("RUST_LOG", "off")  # Rerun's own words about a window that was closed
    job = pickle.load(sys.stdin.buffer)  # from the daemon that started this process, nobody else has the pipe
    assert isinstance(job, ViewerJob)
    try:
        reader = RingReader(job.ring)
    except ContidError:
        return 0  # the run was over before this process began
    try:
        viewer = Viewer(job, reader)
        try:
            viewer.run()
        finally:
            viewer.close()
    except ContidError as error:
        sys.stderr.write(f"contid: view: {error}\n")
        return error.exit_code
    finally:
        reader.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
