"""A viewer as an observer of the daemon: a process for a real run, a sink for one in virtual time."""

from __future__ import annotations

import os
import pickle
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

from contid.control.daemon.spawn import ENVIRONMENT, module_command
from contid.control.engine.cycle import Sink
from contid.control.engine.events import RunEvent
from contid.control.engine.messages import Message
from contid.control.engine.wiring import record_layout
from contid.control.process.pipe import RunSetup
from contid_view.frames import BATCH, Decimator
from contid_view.view_target import ViewerJob, ViewTarget

#: How long the end of a run waits for the viewer to draw the last frames, in a window or on a page.
EXIT_TIMEOUT_S: Final = 5.0
#: The same for a file: on a busy machine the viewer of a short run has only begun to import.
FILE_TIMEOUT_S: Final = 30.0


class ViewerObserver:
    """Draws one run; a `contid.control.daemon.interfaces.RunObserver`."""

    def __init__(self, target: ViewTarget) -> None:
        """Prepare; see `contid_view.view_target.check`."""
        self._target = target
        #: The file that was asked for is missing or has no end.
        self.lost = False
        self._process: subprocess.Popen[bytes] | None = None
        self._sink: DrawingSink | None = None

    @property
    def pid(self) -> int | None:
        """Process id of the viewer."""
        return None if self._process is None else self._process.pid

    def attach(self, setup: RunSetup, pid: int) -> None:
        """Start the viewer's process without waiting: the ring keeps what it misses while it imports.

        It gets the ring as an open file: a short run may have ended, and removed the ring, before the viewer
        has imported.

        Raises:
            OSError: no process or file can be opened.
        """
        ring = os.open(setup.ring, os.O_RDWR | os.O_CLOEXEC)
        try:
            self._process = process = subprocess.Popen(
                module_command("contid_view.viewer_process"),
                stdin=subprocess.PIPE,
                start_new_session=True,
                pass_fds=(ring,),
                env={**os.environ, **ENVIRONMENT},
            )
        finally:
            os.close(ring)
        assert process.stdin is not None
        job = ViewerJob(self._target, Path(f"/dev/fd/{ring}"), pid, setup.loaded, setup.rate_hz)
        with suppress(BrokenPipeError), process.stdin:  # closed also where the viewer has ended already
            process.stdin.write(pickle.dumps(job))

    def follow(self, setup: RunSetup) -> Sink:
        """Draw a run in virtual time within this process."""
        self._sink = DrawingSink(self._target, setup)
        return self._sink

    def before_order(self, message: Message) -> None:
        """Not used: the effects of an order are in the records."""

    def detach(self) -> Sequence[str]:
        """Wait for the last frames, `EXIT_TIMEOUT_S` or `FILE_TIMEOUT_S`; returns what went wrong."""
        if self._sink is not None:
            self._sink.close()
            self._sink = None
        process, self._process = self._process, None
        if process is None:
            return ()
        file = self._target.path
        with suppress(OSError):  # needs a right; no tick is left that the viewer could delay
            os.sched_setscheduler(process.pid, os.SCHED_OTHER, os.sched_param(0))
        try:
            status = process.wait(EXIT_TIMEOUT_S if file is None else FILE_TIMEOUT_S)
            problem = f"ended with status {status}" if status else ""
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            problem = "did not end and was killed"
        if file is not None and problem:
            self.lost = True
            problem += f"; {file} {'has no end' if file.exists() else 'is missing'}"
        return (f"the viewer {problem}",) if problem else ()


class DrawingSink:
    """Draws the ticks of a run in virtual time; see `contid.control.engine.cycle.Sink`."""

    def __init__(self, target: ViewTarget, setup: RunSetup) -> None:
        from contid_view.rerun.session import RerunSession  # only a run that draws here imports Rerun

        self._session = RerunSession(target, setup.loaded, setup.rate_hz, live=False)
        layout = record_layout(setup.loaded, setup.rate_hz)
        self._decimator = Decimator(layout, self._session.writer.write, BATCH)

    def write(self, values: list[float]) -> None:
        """Draw a tick."""
        self._decimator.add(values)

    def event(self, event: RunEvent) -> None:
        """Draw an event."""
        self._session.writer.event(event)

    def close(self) -> None:
        """Draw the last frames."""
        self._decimator.finish()
        self._session.close()
