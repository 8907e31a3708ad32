"""Who takes part in a run: sources of commands, what they may ask of it, and those that only read along.

Every command to a run goes through `RunControl`; the socket server of `contid.remote` is a `CommandSource`.
A `RunObserver`, such as a recorder or a viewer, gets the path of the ring and reads at its own pace.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

from contid.control.engine.cycle import Sink
from contid.control.engine.messages import Message
from contid.control.engine.tick_layout import TickRecord
from contid.control.process.setup import RunSetup
from contid.control.tick.preflight import Unreachable
from contid.robot_file.load import LoadedFile


class RunControl(Protocol):
    """What a source of commands may do with a run."""

    @property
    def loaded(self) -> LoadedFile:
        """The robot file."""
        ...

    @property
    def rate_hz(self) -> float:
        """Of the tick."""
        ...

    @property
    def unreachable(self) -> Unreachable:
        """What to do with targets out of reach."""
        ...

    @property
    def input_moves(self) -> bool:
        """True while stdin or --trajectory is what the robots follow."""
        ...

    @property
    def waiting(self) -> str:
        """What the run waits for before it begins, "" once it has begun."""
        ...

    def say(self, message: str) -> None:
        """A message for the person at the daemon."""
        ...

    def displace_input(self) -> None:
        """Hold, and follow the input of the run no more."""
        ...

    def send(self, message: Message) -> None:
        """Give an order to the control process."""
        ...

    def send_bulk(self, message: Message) -> None:
        """Give a long order, its arrays by way of shared memory: nothing waits behind it."""
        ...

    def newest(self) -> TickRecord | None:
        """The newest record."""
        ...

    def lateness(self, ticks: int) -> list[float]:
        """How late the newest ticks started [s]."""
        ...

    def refresh(self) -> None:
        """Hear of every event up to now at once."""
        ...

    def listen(self, listener: Callable[[Mapping[str, Any]], None]) -> None:
        """Call ``listener`` with every further event."""
        ...

    def interrupt(self) -> None:
        """End the run: orderly the first time, relax or vent now the second."""
        ...


class CommandSource(Protocol):
    """A source of commands, such as the socket."""

    async def serve(self, orders: RunControl) -> None:
        """Take commands until cancelled."""
        ...


class RunObserver(Protocol):
    """Something that reads the ring, such as a recorder in its own process."""

    def attach(self, setup: RunSetup, pid: int) -> None:
        """Begin: ``setup`` names the ring, ``pid`` is its writer; called before the first tick.

        Raises:
            ContidError: it cannot; nothing is started then.
        """
        ...

    def follow(self, setup: RunSetup) -> Sink:
        """The same for a run in virtual time, which has no ring: a sink within this process."""
        ...

    def told(self, message: Message) -> None:
        """An order is about to go to the control process; of a `Play`, events do not hold the content."""
        ...

    def detach(self) -> Sequence[str]:
        """The ring is finished: read the rest and end, within a bounded time.

        Returns:
            What went wrong, in words for the report.
        """
        ...
