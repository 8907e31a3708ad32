"""Interfaces of the participants in a run: `RunControl`, `CommandSource`, `RunObserver`, `RunRecordings`.

Every command to a run goes through `RunControl`; the socket server of `contid.remote` is a `CommandSource`,
and its task one of `CommandTasks`.
A `RunObserver`, such as a recorder or a viewer, gets the path of the ring and reads at its own pace.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Sequence
from pathlib import Path
from typing import Any, Protocol

from contid.control.engine.cycle import Sink
from contid.control.engine.events import RunEvent
from contid.control.engine.events.run import NoteWritten
from contid.control.engine.messages import Message
from contid.control.engine.tick_layout import TickRecord
from contid.control.process.pipe import RunSetup
from contid.control.tick.preflight.rows import Unreachable
from contid.robot_file.load import LoadedFile


class RunControl(Protocol):
    """A run as a source of commands sees it."""

    @property
    def loaded(self) -> LoadedFile:
        """The robot file."""

    @property
    def rate_hz(self) -> float:
        """Ticks per second."""

    @property
    def unreachable(self) -> Unreachable:
        """What to do with targets out of reach."""

    @property
    def input_active(self) -> bool:
        """True while the robots follow stdin or --trajectory."""

    @property
    def waiting(self) -> str:
        """What the run waits for before it begins, "" once it has begun."""

    def detach_input(self) -> None:
        """Hold, and stop following the input of the run."""

    def send(self, message: Message) -> None:
        """Send an order to the control process."""

    def note(self, event: NoteWritten) -> None:
        """Write a note into the events of the run."""

    def newest(self) -> TickRecord | None:
        """The newest record."""

    def record_of(self, tick: int) -> TickRecord | None:
        """The record of a tick, or of the first one after it; None before it is written."""

    def lateness(self, ticks: int) -> list[float]:
        """How late the newest ticks started [s]."""

    def costs(self) -> list[float]:
        """Mean duration of the newest ticks of each robot [s]; empty before the first."""

    def refresh(self) -> None:
        """Deliver every event up to now to the listeners."""

    def listen(self, listener: Callable[[RunEvent], None]) -> None:
        """Call ``listener`` with every further event."""

    def interrupt(self) -> None:
        """End the run: orderly on the first call, relax or vent at once on the second."""


class CommandSource(Protocol):
    """A source of commands, such as the socket server."""

    async def serve(self, control: RunControl) -> None:
        """Serve until cancelled."""


class RunObserver(Protocol):
    """A reader of the ring, such as a recorder in its own process."""

    def attach(self, setup: RunSetup, pid: int) -> None:
        """Start reading before the first tick.

        Args:
            setup: names the ring.
            pid: of the process that writes it.

        Raises:
            ContidError: it cannot start; the run is not started either.
        """

    def follow(self, setup: RunSetup) -> Sink:
        """The same for a run in virtual time, which has no ring: returns a sink in this process."""

    def before_order(self, message: Message) -> None:
        """An order is about to be sent; events do not hold the trajectory of a `Play`.

        Raises:
            ContidError: the trajectory is not kept; the order is carried out all the same.
        """

    def detach(self) -> Sequence[str]:
        """The ring is finished: read the rest and end within a bounded time; returns problems to report."""


class RunRecordings(Protocol):
    """Recordings that clients begin and end; they name no path: `contid.session.recordings`."""

    async def begin(self, by: str) -> tuple[Path, bool]:
        """Begin a recording for a client; its file, and whether ticks are written already.

        Raises:
            ContidError: there is one, or its file cannot be written.
        """

    async def end(self, by: str) -> tuple[Path, bool]:
        """End it; its file, and whether that is complete already.

        Raises:
            ContidError: there is none.
        """

    def watch(self) -> None:
        """Look after recorders that have ended; called periodically."""

    def as_fields(self) -> list[dict[str, Any]]:
        """Every recording under way, for ``status``."""


class CommandTasks:
    """The tasks of the sources of commands; when one fails, the run ends: clients could not stop it.

    Args:
        failed: called with a message when a task ended with an error.
    """

    def __init__(self, failed: Callable[[str], None]) -> None:
        self._failed = failed
        self._tasks: list[asyncio.Task[None]] = []

    def start(self, source: Coroutine[Any, Any, None]) -> None:
        """Run a source of commands beside the run."""
        task = asyncio.create_task(source)
        task.add_done_callback(self._ended)
        self._tasks.append(task)

    def _ended(self, task: asyncio.Task[None]) -> None:
        error = None if task.cancelled() else task.exception()
        if error is not None:
            self._failed(f"a source of commands ended early: {type(error).__name__}: {error}")

    async def end(self) -> None:
        """Cancel all and wait for them."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
