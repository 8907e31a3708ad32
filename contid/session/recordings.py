"""Recordings that clients begin and end during a run, one at a time.

The daemon chooses folder and name; a client names no path. Such a recording begins in the middle of a run,
so it can be shown, exported and checked, but not replayed: it lacks the state of the engine at its begin.
"""

from __future__ import annotations

import asyncio
import logging
import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from contid.control.engine.cycle import Sink
from contid.control.engine.messages import Message
from contid.control.process.pipe import RunSetup
from contid.errors import ContidError

if TYPE_CHECKING:
    from contid.session.recording_observer import RecordingObserver

#: How long a client waits for the start of the recorder's process; on a busy machine it goes on alone.
START_TIMEOUT_S: Final = 4.0
#: How long the end of a recording is waited for; compaction of a long one takes longer and goes on alone.
END_TIMEOUT_S: Final = 2.0
POLL_S: Final = 0.02
#: Names that are tried when recordings begin in the same second.
MAX_SAME_SECOND: Final = 20

log = logging.getLogger(__name__)


@dataclass(slots=True)
class OrderedRecording:
    """A recording by order.

    Attributes:
        observer: its recorder.
        by: the client that began it.
        began_s: when, by `time.monotonic`.
        starting: the start of the recorder; None when it records the whole run.
        ending: its end was ordered; the recorder completes the file.
        reported: ticks missed, and whether the recorder has failed, as they were reported last.
    """

    observer: RecordingObserver
    by: str
    began_s: float
    starting: asyncio.Task[None] | None = None
    ending: bool = False
    reported: tuple[int, bool] = (0, False)

    def report_losses(self) -> None:
        """Log what is newly missing in the file, for terminals, the recording of others and ``status``."""
        observer = self.observer
        observer.watch()
        found = observer.missed_ticks, observer.failed
        if found[0] > self.reported[0]:
            log.warning("%s: lacks %d ticks so far; the disk is too slow", observer.path, found[0])
        if found[1] and not self.reported[1]:
            log.error("%s: the recorder has failed; nothing more is recorded", observer.path)
        self.reported = found

    @property
    def started(self) -> bool:
        """The recorder writes, or could not be started."""
        return self.starting is None or self.starting.done()

    @property
    def state(self) -> str:
        """``starting``, ``recording``, ``ending`` or ``failed``."""
        if self.observer.failed:
            return "failed"
        return "ending" if self.ending else "recording" if self.started else "starting"

    def as_fields(self, whole_run: bool) -> dict[str, Any]:
        """For ``status``."""
        return {
            "file": str(self.observer.path.absolute()),
            "whole_run": whole_run,
            "by": self.by,
            "seconds": round(time.monotonic() - self.began_s, 1),
            "missed_ticks": self.observer.missed_ticks,
            "state": self.state,
        }


class OrderDone(NamedTuple):
    """The file of a recording, and whether what was ordered is done already or goes on."""

    path: Path
    done: bool


class Recordings:
    """The recordings of one run; a `contid.control.daemon.interfaces.RunObserver`.

    Args:
        folder: path of the files.
        options: options of the run, for the metadata.
        run: the recording of the whole run, if there is one; it is listed, and ends with the run only.
    """

    def __init__(
        self, folder: Path, options: Mapping[str, str], run: RecordingObserver | None = None
    ) -> None:
        self._folder = folder
        self._options = dict(options)
        self._run = None if run is None else OrderedRecording(run, "", time.monotonic())
        self._setup: tuple[RunSetup, int] | None = None
        self._current: OrderedRecording | None = None
        self._ending: list[OrderedRecording] = []
        self._one = asyncio.Lock()

    # -- orders --------------------------------------------------------------------------------------------

    async def begin(self, by: str) -> OrderDone:
        """Begin a recording; done when ticks are written already.

        Args:
            by: name of the client that orders it.

        Raises:
            ContidError: there is one, the run has not begun, or the file cannot be written.
        """
        async with self._one:
            current = self._current
            if current is not None:
                name = current.observer.path.name
                raise ContidError(f"{name} is being recorded, begun by {current.by}; end it first")
            if self._setup is None:
                raise ContidError("the run has not begun: it waits for its input")
            observer = self._observer(self._setup[0], by)
            # In a thread: orders to stop must not wait for the start of a process.
            starting = asyncio.create_task(asyncio.to_thread(observer.attach, *self._setup))
            self._current = OrderedRecording(observer, by, time.monotonic(), starting)
            await asyncio.wait({starting}, timeout=START_TIMEOUT_S)
            if starting.done() and (error := starting.exception()) is not None:
                self._current = None
                raise error
        log.info("%s: recording, begun by %s", observer.path, by)
        return OrderDone(observer.path, starting.done())

    async def end(self, by: str) -> OrderDone:
        """End the recording; done when the file is complete already.

        Args:
            by: name of the client that orders it.

        Raises:
            ContidError: there is none.
        """
        async with self._one:
            recording = self._current
            if recording is None:
                raise ContidError("there is no recording that was begun by an order")
            if not recording.started:
                raise ContidError(f"{recording.observer.path.name} is still being started")
            self._current = None
            recording.ending = True
            self._ending.append(recording)
            recording.observer.end()
        log.info("%s: ended by %s", recording.observer.path, by)
        deadline_s = time.monotonic() + END_TIMEOUT_S
        while recording.observer.running and time.monotonic() < deadline_s:
            await asyncio.sleep(POLL_S)
        self.watch()
        return OrderDone(recording.observer.path, not recording.observer.running)

    def watch(self) -> None:
        """Report recorders that missed ticks, that failed, or that have ended as ordered."""
        for recording in (self._run, self._current):
            if recording is not None and recording.started:
                recording.report_losses()
        for recording in [*self._ending]:
            if not recording.observer.running:
                self._ending.remove(recording)
                self._report(recording)
        current = self._current
        # While the lock is held, `begin` waits for the start and reports it.
        if current is None or not current.started or self._one.locked() or current.observer.running:
            return
        self._current = None
        self._report(current)

    def _report(self, recording: OrderedRecording) -> None:
        error = recording.starting.exception() if recording.starting is not None else None
        for message in [str(error)] if error is not None else recording.observer.detach():
            log.warning(message)

    def as_fields(self) -> list[dict[str, Any]]:
        """For ``status``: every recording that is under way."""
        found = []
        if self._run is not None and (self._run.observer.running or self._run.observer.failed):
            found.append(self._run.as_fields(whole_run=True))
        ordered = [*self._ending, *([self._current] if self._current is not None else [])]
        return found + [recording.as_fields(whole_run=False) for recording in ordered]

    def _observer(self, setup: RunSetup, by: str) -> RecordingObserver:
        # Imported when it is needed: the start of a run does not wait for it.
        from contid.session.recording_observer import RecordingObserver

        return RecordingObserver(self._free_path(setup), {**self._options, "begun_by": by}, during_run=True)

    def _free_path(self, setup: RunSetup) -> Path:
        stem = re.sub(r"[^A-Za-z0-9_.-]+", "_", Path(str(setup.loaded.path)).stem).strip(".") or "robot"
        base = f"{stem}-{datetime.now().astimezone():%Y%m%d-%H%M%S}"
        for number in range(1, MAX_SAME_SECOND):
            path = self._folder / (f"{base}.mcap" if number == 1 else f"{base}-{number}.mcap")
            if not path.exists():
                return path
        raise ContidError(f"{self._folder}: {base} and the following names are taken")

    # -- observer ------------------------------------------------------------------------------------------

    def attach(self, setup: RunSetup, pid: int) -> None:
        """Keep what a recorder needs; nothing is recorded yet."""
        self._setup = setup, pid
        if self._run is not None:
            self._run.began_s = time.monotonic()

    def follow(self, setup: RunSetup) -> Sink:
        """There are no clients in virtual time."""
        raise NotImplementedError

    def before_order(self, message: Message) -> None:
        """Keep the trajectory of an order in the present recording."""
        # A line before the job of a recorder that is being started would make its start fail.
        if self._current is not None and self._current.started:
            self._current.observer.before_order(message)

    def detach(self) -> Sequence[str]:
        """Wait until every recording is complete; returns errors."""
        self._setup = None
        left = [*self._ending, *([self._current] if self._current is not None else [])]
        self._ending, self._current = [], None
        left = [recording for recording in left if recording.started]  # the others end with the ring
        return [message for recording in left for message in recording.observer.detach()]
