"""A recording as an observer of the daemon: a process for a real run, a sink for one in virtual time."""

from __future__ import annotations

import os
import pickle
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

from contid.control.daemon.spawn import ENVIRONMENT, module_command
from contid.control.engine.cycle import Sink
from contid.control.engine.messages import Message, Play
from contid.control.process.pipe import RunSetup
from contid.control.process.ring import SECONDS
from contid.control.process.shared_files import ATTACHED_FILES, folder
from contid.errors import ContidError
from contid.session.format.header import END, NPZ, Attached, RecorderJob
from contid.session.format.metadata import (
    DURING_RUN,
    TRAJECTORY,
    describe,
    encode_trajectory,
    trajectory_metadata,
)
from contid.session.mcap_recorder import MISSED, READY
from contid.session.write import SessionWriter, compact

#: How long the end of a run waits for compaction; a session of 45 minutes of a hand takes a third of it.
COMPACTION_TIMEOUT_S: Final = 120.0
#: How long a recorder that could not start has to end; it has nothing to complete.
FAILED_START_TIMEOUT_S: Final = 5.0


class RecordingObserver:
    """Records one run; a `contid.control.daemon.interfaces.RunObserver`."""

    def __init__(
        self, path: Path, options: Mapping[str, str], host: str | None = None, during_run: bool = False
    ) -> None:
        """Prepare.

        Args:
            path: path of the session; must not exist.
            options: options of the run, for the metadata.
            host: instead of this machine's name.
            during_run: it begins with the tick after `attach`, not with the first one of the run.
        """
        self.path = path
        self._during_run = during_run
        self._options = dict(options) | ({DURING_RUN: "true"} if during_run else {})
        self._host = host
        self._process: subprocess.Popen[bytes] | None = None
        self._writer: SessionWriter | None = None
        self._played = 0  # trajectories of orders so far
        self._sent: list[Path] = []  # files of trajectories for the recorder to remove
        self._lines = b""  # of the recorder, not read to their end
        self._errors: list[str] = []
        #: The recorder failed: records are missing from the session.
        self.lost = False
        #: Ticks that are missing because the disk was too slow.
        self.missed_ticks = 0

    def attach(self, setup: RunSetup, pid: int) -> None:
        """Start the recorder's process and wait until it has created its file.

        Raises:
            ContidError: the file exists or cannot be written.
        """
        # In a session of its own: signals to the daemon's process group do not reach it.
        self._process = process = subprocess.Popen(
            module_command("contid.session.mcap_recorder"),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            bufsize=0,
            start_new_session=True,
            env={**os.environ, **ENVIRONMENT},
        )
        assert process.stdin is not None
        assert process.stdout is not None
        header = describe(setup, self._options, virtual=False, host=self._host)
        try:
            job = RecorderJob(self.path.absolute(), setup.ring, pid, header, self._during_run)
            pickle.dump(job, process.stdin)
            process.stdin.flush()
            answer = process.stdout.readline().decode().strip()
        except BrokenPipeError:
            answer = ""
        if answer != READY:
            self._close(FAILED_START_TIMEOUT_S)
            raise ContidError(answer or "the recorder did not start")
        os.set_blocking(process.stdout.fileno(), False)

    def follow(self, setup: RunSetup) -> Sink:
        """Record a run in virtual time within this process.

        Raises:
            ContidError: as `attach`.
        """
        header = describe(setup, self._options, virtual=True, host=self._host)
        self._writer = SessionWriter(self.path, header)
        return self._writer

    def before_order(self, message: Message) -> None:
        """Send the trajectory of an order to the recorder; other orders are complete in their events."""
        if not isinstance(message, Play):
            return
        self._played += 1
        name, metadata = f"{TRAJECTORY}-{self._played}", trajectory_metadata(message.trajectory)
        # Not compressed, which would take longer: the order waits for it.
        data = encode_trajectory(message.trajectory, at_once=True)
        if self._writer is not None:
            self._writer.attach(name, NPZ, data, metadata)
        elif self._process is not None and self._process.stdin is not None:
            self._send(Attached(name, metadata, str(self._shared(data))))

    def _shared(self, data: bytes) -> Path:
        """Data as a file in shared memory: a pipe would block the daemon until the recorder has read it.

        Raises:
            ContidError: there is no space; the trajectory is not in the recording.
        """
        front, back = ATTACHED_FILES.split("*")
        path = None
        try:
            descriptor, name = tempfile.mkstemp(back, f"{front}{os.getpid()}-", folder())
            path = Path(name)
            with os.fdopen(descriptor, "wb") as file:
                file.write(data)
        except OSError as error:
            if path is not None:
                path.unlink(missing_ok=True)
            message = f"{self.path}: lacks the trajectory of a move, so it cannot be replayed from there"
            raise ContidError(f"{message}: {folder()}: {error.strerror}") from error
        self._sent.append(path)
        return path

    def _send(self, attached: Attached) -> None:
        """Name a file to the recorder, which removes it; without a recorder it is removed here."""
        assert self._process is not None
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(attached.line())
            self._process.stdin.flush()
        except BrokenPipeError:
            Path(attached.path).unlink(missing_ok=True)

    @property
    def running(self) -> bool:
        """The recorder's process has not ended."""
        return self._process is not None and self._process.poll() is None

    @property
    def failed(self) -> bool:
        """The recorder's process has ended with an error, or was killed, and is not closed yet."""
        return self._process is not None and self._process.poll() not in (None, 0)

    def watch(self) -> None:
        """Take in what the recorder has to report: ticks that it missed, and errors."""
        if self._process is not None:
            self._take_reports(self._process)

    def _take_reports(self, process: subprocess.Popen[bytes]) -> None:
        assert process.stdout is not None
        *lines, self._lines = (self._lines + (process.stdout.read() or b"")).split(b"\n")
        for line in lines:
            text = line.decode(errors="replace")
            if text.startswith(MISSED):
                self.missed_ticks = int(text.removeprefix(MISSED))
            else:
                self._errors.append(text)

    def end(self) -> None:
        """End the recording before the run ends; the recorder completes the file by itself."""
        if self._process is not None and self._process.stdin is not None:
            with suppress(BrokenPipeError):
                self._process.stdin.write(END)
                self._process.stdin.flush()

    def detach(self) -> Sequence[str]:
        """Wait until the session is complete; returns errors."""
        if self._writer is not None:
            writer, self._writer = self._writer, None
            try:
                writer.finish()
            finally:
                writer.close()
            compact(self.path, writer.status)
        if self._process is None:
            return ()
        return self._close(COMPACTION_TIMEOUT_S)

    def _close(self, timeout_s: float) -> tuple[str, ...]:
        """Close the recorder's pipe and wait for its end; returns errors.

        A recorder that has not ended in time counts as compacting: it goes on without this process.
        """
        process, self._process = self._process, None
        assert process is not None
        assert process.stdin is not None
        assert process.stdout is not None
        with suppress(BrokenPipeError):
            process.stdin.close()
        with suppress(subprocess.TimeoutExpired, KeyboardInterrupt):  # Ctrl-C ends the wait, not the report
            process.wait(timeout_s)
        status = process.returncode  # None: it has not ended
        os.set_blocking(process.stdout.fileno(), False)
        self._take_reports(process)
        process.stdout.close()
        errors, self._errors = self._errors, []
        self.lost = bool(status) or self.missed_ticks > 0
        if self.missed_ticks:
            slow = f"the disk was too slow for more than {SECONDS:g} s"
            errors.append(f"{self.path}: lacks {self.missed_ticks} ticks; {slow}")
        if status is None:
            errors.append(f"{self.path}: complete; it is still being compacted")
            return tuple(errors)
        for path in self._sent:  # a recorder that was killed has not removed them
            path.unlink(missing_ok=True)
        if status and not errors:
            errors.append(f"{self.path}: the recorder ended with status {status}")
        return tuple(errors)
