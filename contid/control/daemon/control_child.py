"""The control process as seen by the daemon: start, send without blocking, terminate."""

from __future__ import annotations

import logging
import os
import subprocess
from contextlib import suppress
from pathlib import Path
from typing import Final

from contid.control.daemon.spawn import Spawned, spawn
from contid.control.engine.messages import Estop, Finish, Hold, Play, Stop
from contid.control.engine.tick_layout import RecordLayout
from contid.control.process import ring
from contid.control.process.pipe import RunSetup, frame, to_shared_memory
from contid.control.process.ring_reader import RingReader
from contid.control.process.shared_files import folder, sweep

#: Bounds the daemon's memory when the control process does not read its pipe. Stops pass the bound: they are
#: small, and `contid.control.daemon.silence_watch` ends a process that stands still.
MAX_BACKLOG: Final = 64 << 20
_STOPS: Final = (Hold, Stop, Estop, Finish)

log = logging.getLogger(__name__)


class ControlChild:
    """One control process, from the start of its interpreter to its exit status."""

    def __init__(self, spawned: Spawned | None = None) -> None:
        spawned = spawned or spawn()
        self._process, self._pipe = spawned.process, spawned.pipe
        self.reader: RingReader | None = None
        self._path: Path | None = None
        self._backlog = bytearray()
        self._dropped = 0
        self._bulk_paths: list[Path] = []

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    @property
    def status(self) -> int | None:
        """Exit status, None while it runs."""
        return self._process.poll()

    def create_ring(self, layout: RecordLayout) -> Path:
        """Create the shared memory of this run and attach to it."""
        sweep()
        self._path = ring.create(layout)
        self.reader = RingReader(self._path)
        return self._path

    def start(self, setup: RunSetup) -> None:
        """Send the setup; blocks until the pipe has taken it."""
        body = memoryview(frame(setup))
        os.set_blocking(self._pipe, True)
        with suppress(BrokenPipeError):
            while body:
                body = body[os.write(self._pipe, body) :]
        os.set_blocking(self._pipe, False)

    def send(self, message: object) -> None:
        """Send a message without blocking; `flush` sends what the pipe does not take yet.

        The arrays of a trajectory are in shared memory, or in the pipe when that is full. Beyond
        `MAX_BACKLOG` all messages but stops are dropped until the backlog is sent: no `Mark` confirms a
        dropped order.
        """
        if isinstance(message, Play) and (bulk := to_shared_memory(message, folder())) is not None:
            self._bulk_paths.append(Path(bulk.path))
            message = bulk
        fits = not self._dropped and len(self._backlog) < MAX_BACKLOG
        if fits or isinstance(message, _STOPS):
            self._backlog += frame(message)
        else:
            self._dropped += 1
            if self._dropped == 1:
                log.error("the control process reads no orders; all but stops are dropped")
        self.flush()

    def flush(self) -> None:
        """Send the backlog."""
        with suppress(BlockingIOError, BrokenPipeError):
            while self._backlog:
                del self._backlog[: os.write(self._pipe, self._backlog)]
            if self._dropped:
                log.warning(f"the control process reads orders again; {self._dropped} messages were dropped")
                self._dropped = 0

    def terminate(self) -> None:
        """Send SIGTERM: ends at once while it opens its buses, by ``on_host_loss`` once it runs."""
        self._process.terminate()

    def kill(self) -> None:
        """Send SIGKILL; the devices' own watchdogs then stop them."""
        self._process.kill()

    def close(self) -> None:
        """Close the pipe (a running control process stops by ``on_host_loss``), wait, remove the files."""
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
        for path in self._bulk_paths:  # never fetched
            path.unlink(missing_ok=True)
        if self._path is not None:
            self._path.unlink(missing_ok=True)
