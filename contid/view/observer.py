"""The daemon's hold on a viewer: a process of its own for a real run, a sink for one in virtual time."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Final

from contid.control.daemon.spawn import ENVIRONMENT
from contid.control.engine.cycle import Sink
from contid.control.engine.messages import Message
from contid.control.engine.wiring import record_layout
from contid.control.process.setup import RunSetup
from contid.view.frames import BATCH, Decimator, Frame
from contid.view.job import ViewerJob
from contid.view.view_target import Kind, ViewTarget

if TYPE_CHECKING:
    from contid.view.rerun_session import RerunSession

#: How long the end of a run waits for the last pictures.
PATIENCE_S: Final = 5.0


class Viewing:
    """Shows one run; an observer of the daemon (`contid.control.daemon.interfaces.Observer`)."""

    def __init__(self, where: ViewTarget) -> None:
        """Prepare to show it there; see `contid.view.view_target.require`."""
        self._where = where
        self._process: subprocess.Popen[bytes] | None = None
        self._sink: DrawingSink | None = None

    @property
    def pid(self) -> int | None:
        """Process id of the viewer."""
        return None if self._process is None else self._process.pid

    def attach(self, setup: RunSetup, pid: int) -> None:
        """Start the viewer's process, wait for nothing: the ring keeps what it misses while it imports."""
        self._process = process = subprocess.Popen(
            [sys.executable, "-m", "contid.view.viewer_process"],
            stdin=subprocess.PIPE,
            start_new_session=True,
            env={**os.environ, **ENVIRONMENT},
        )
        assert process.stdin is not None
        job = ViewerJob(self._where, setup.ring, pid, setup.loaded, setup.rate_hz)
        with suppress(BrokenPipeError):
            process.stdin.write(pickle.dumps(job))
            process.stdin.close()

    def follow(self, setup: RunSetup) -> Sink:
        """Draw a run in virtual time within this process."""
        self._sink = DrawingSink(self._where, setup)
        return self._sink

    def before_order(self, message: Message) -> None:
        """A viewer shows what comes of orders."""

    def detach(self) -> Sequence[str]:
        """Wait for the last pictures, but not for long; returns what went wrong."""
        if self._sink is not None:
            self._sink.close()
            self._sink = None
        process, self._process = self._process, None
        if process is None:
            return ()
        try:
            status = process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            cut = f"; {self._where.path} has no end" if self._where.kind is Kind.FILE else ""
            return (f"the viewer did not end and was killed{cut}",)
        return (f"the viewer ended with status {status}",) if status else ()


class DrawingSink:
    """Takes the ticks of a run in virtual time."""

    def __init__(self, where: ViewTarget, setup: RunSetup) -> None:
        from contid.view.rerun_session import RerunSession
        from contid.view.stage import build_stage

        loaded = setup.loaded
        stage = build_stage(loaded, setup.rate_hz)
        self._host: RerunSession = RerunSession(where, loaded.file.name, stage, setup.rate_hz, live=False)
        self._decimator = Decimator(record_layout(loaded, setup.rate_hz))
        self._frames: list[Frame] = []

    def write(self, values: list[float]) -> None:
        """See `contid.control.engine.cycle.Sink`."""
        frame = self._decimator.add(values)
        if frame is not None:
            self._frames.append(frame)
            if len(self._frames) >= BATCH:
                self._draw()

    def event(self, kind: str, **fields: Any) -> None:
        """See `contid.control.engine.cycle.Sink`."""
        event: Mapping[str, Any] = {"event": kind, **fields}
        self._host.picture.event(event)

    def close(self) -> None:
        """Draw the rest."""
        if (frame := self._decimator.rest()) is not None:
            self._frames.append(frame)
        self._draw()
        self._host.close()

    def _draw(self) -> None:
        self._host.picture.write(self._frames)
        self._frames.clear()
