"""The daemon's hold on the control process: start it early, talk without waiting, end it for certain."""

from __future__ import annotations

import os
import subprocess
from contextlib import suppress
from pathlib import Path
from typing import Final

from contid.control.daemon.spawn import Spawned, spawn
from contid.control.engine.tick_layout import RecordLayout
from contid.control.process import ring
from contid.control.process.pipe import aside, frame
from contid.control.process.setup import RunSetup

#: A control process that ignores its pipe must not make the daemon's memory grow.
MAX_BACKLOG: Final = 64 << 20


class ControlChild:
    """A control process, from the start of its interpreter to its last status."""

    def __init__(self, spawned: Spawned | None = None) -> None:
        spawned = spawned or spawn()
        self._process, self._pipe = spawned.process, spawned.pipe
        self.reader: ring.RingReader | None = None
        self._path: Path | None = None
        self._backlog = bytearray()
        self._asides: list[Path] = []

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    @property
    def status(self) -> int | None:
        """Exit status, None while it runs."""
        return self._process.poll()

    def create_ring(self, layout: RecordLayout) -> Path:
        """Make the shared memory of this run and attach to it."""
        ring.sweep()
        self._path = ring.create(layout)
        self.reader = ring.RingReader(self._path)
        return self._path

    def begin(self, setup: RunSetup) -> None:
        """Hand over what it needs; waits until it has taken it."""
        body = memoryview(frame(setup))
        os.set_blocking(self._pipe, True)
        with suppress(BrokenPipeError):
            while body:
                body = body[os.write(self._pipe, body) :]
        os.set_blocking(self._pipe, False)

    def send(self, message: object) -> None:
        """Send a message; never waits, keeps what the pipe does not take yet for `flush`."""
        if len(self._backlog) < MAX_BACKLOG:
            self._backlog += frame(message)
        self.flush()

    def send_bulk(self, message: object) -> None:
        """Send a long message, its arrays by way of shared memory; through the pipe when that is full."""
        beside = aside(message, ring.folder())
        if beside is None:
            self.send(message)
            return
        self._asides.append(Path(beside.path))
        self.send(beside)

    def flush(self) -> None:
        """Send what is kept."""
        with suppress(BlockingIOError, BrokenPipeError):
            while self._backlog:
                del self._backlog[: os.write(self._pipe, self._backlog)]

    def terminate(self) -> None:
        """Ask it to end: at once while it opens its buses, by ``on_host_loss`` once it runs."""
        self._process.terminate()

    def kill(self) -> None:
        """End it now; the devices' own dead-man is what stops them then."""
        self._process.kill()

    def close(self) -> None:
        """Close the pipe (a running control process then stops by ``on_host_loss``), wait, clean up."""
        if self._pipe >= 0:
            os.close(self._pipe)
            self._pipe = -1
        try:
            self._process.wait(4.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self.reader is not None:
            self.reader.close()
        for path in self._asides:  # what was never fetched
            path.unlink(missing_ok=True)
        if self._path is not None:
            self._path.unlink(missing_ok=True)
