"""A viewer as an observer of the daemon: a process for a real run, a sink for one in virtual time."""

from __future__ import annotations

import os
import pickle
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from typing import Final

from contid.child_module import module_command
from contid.control.daemon.spawn import ENVIRONMENT
from contid.control.engine.cycle import Sink
from contid.control.engine.events.base import RunEvent
from contid.control.engine.messages import Message
from contid.control.engine.wiring import record_layout
from contid.control.process.setup import RunSetup
from contid.view.frames import BATCH, Decimator
from contid.view.view_target import Kind, ViewerJob, ViewTarget

#: How long the end of a run waits for the viewer to draw the last frames.
EXIT_TIMEOUT_S: Final = 5.0


class ViewerObserver:
    """Draws one run; a `contid.control.daemon.interfaces.RunObserver`."""

    def __init__(self, target: ViewTarget) -> None:
        """Prepare; see `contid.view.view_target.check`."""
        self._target = target
        self._process: subprocess.Popen[bytes] | None = None
        self._sink: DrawingSink | None = None

    @property
    def pid(self) -> int | None:
        """Process id of the viewer."""
        return None if self._process is None else self._process.pid

    def attach(self, setup: RunSetup, pid: int) -> None:
        """Start the viewer's process without waiting: the ring keeps what it misses while it imports."""
        self._process = process = subprocess.Popen(
            module_command("contid.view.viewer_process"),
            stdin=subprocess.PIPE,
            start_new_session=True,
            env={**os.environ, **ENVIRONMENT},
        )
        assert process.stdin is not None
        job = ViewerJob(self._target, setup.ring, pid, setup.loaded, setup.rate_hz)
        with suppress(BrokenPipeError):
            process.stdin.write(pickle.dumps(job))
            process.stdin.close()

    def follow(self, setup: RunSetup) -> Sink:
        """Draw a run in virtual time within this process."""
        self._sink = DrawingSink(self._target, setup)
        return self._sink

    def before_order(self, message: Message) -> None:
        """Not used: the effects of an order are in the records."""

    def detach(self) -> Sequence[str]:
        """Wait up to `EXIT_TIMEOUT_S` for the last frames; returns what went wrong."""
        if self._sink is not None:
            self._sink.close()
            self._sink = None
        process, self._process = self._process, None
        if process is None:
            return ()
        try:
            status = process.wait(EXIT_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            cut = f"; {self._target.path} has no end" if self._target.kind is Kind.FILE else ""
            return (f"the viewer did not end and was killed{cut}",)
        return (f"the viewer ended with status {status}",) if status else ()


class DrawingSink:
    """Draws the ticks of a run in virtual time; see `contid.control.engine.cycle.Sink`."""

    def __init__(self, target: ViewTarget, setup: RunSetup) -> None:
        from contid.view.rerun_session import RerunSession  # only a run that draws here imports Rerun

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
