"""What takes a client more than one request, step by step and without I/O.

A procedure is a generator: it yields what has to be done next (`Ask`, `Pause`, `Listen`), is sent the result
of a request, and returns what the caller wants to know. `contid.remote.client.sync_client` and
`contid.remote.client.async_client` carry the steps out, each in its way of waiting.
"""

from __future__ import annotations

import time
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, TypeAlias, TypeVar

from contid.remote.client.client_protocol import ClientProtocol
from contid.remote.protocol.wire import Fields

T = TypeVar("T")

#: Which robots: one by name, several, or None for all.
Robots: TypeAlias = str | tuple[str, ...] | list[str] | None

#: How often a client that only waits shows that it is alive: well within the lease's two seconds.
ALIVE_S: Final = 0.5
#: How often a client looks whether robots are armed by now.
LOOK_S: Final = 0.02
#: Rows of a timed trajectory that go in one request.
ROWS_AT_ONCE: Final = 256

_NOT_ARMED_YET: Final = {"CONNECTING", "READY", "ARMING"}


@dataclass(frozen=True, slots=True)
class Ask:
    """Make a request; its result is sent back."""

    verb: str
    fields: Fields = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Pause:
    """Let time pass [s]."""

    seconds: float


@dataclass(frozen=True, slots=True)
class Listen:
    """Wait until a notice comes, so many seconds at most."""

    seconds: float


Step: TypeAlias = Ask | Pause | Listen
#: A procedure that returns a T; what is sent to it is the result of an `Ask`, and of no meaning otherwise.
Steps: TypeAlias = Generator[Step, Fields, T]


def listen(dialogue: ClientProtocol) -> Steps[None]:
    """Wait for a notice; whoever waits in a loop of these is seen to be alive and keeps the lease."""
    yield Listen(ALIVE_S)
    if time.monotonic() - dialogue.asked_s > ALIVE_S:
        yield Ask("ping")


def resume(robots: Robots, wait: bool) -> Steps[Fields]:
    """Resume, and wait until the robots are armed."""
    told = yield Ask("resume", {"robots": list_of(robots)})
    while wait and _NOT_ARMED_YET & set(told["robots"].values()):
        yield Pause(LOOK_S)
        status = yield Ask("status")
        told["robots"] = {name: status["robots"][name]["state"] for name in told["robots"]}
    return told


def move(dialogue: ClientProtocol, target: Mapping[str, float], wait: bool) -> Steps[int]:
    """Go to a point, and wait for the arrival; the number of the move."""
    told = yield Ask("move", {"target": dict(target)})
    number = int(told["move"])
    if wait:
        yield from arrival(dialogue, number)
    return number


def arrival(dialogue: ClientProtocol, number: int) -> Steps[None]:
    """Wait until a move has ended.

    Raises:
        RemoteError: it was stopped before its end.
    """
    while not dialogue.arrived(number):
        yield from listen(dialogue)


class RowSender:
    """A stream of rows under the daemon's credit.

    Attributes:
        refused: rows that were refused so far, in words.
    """

    def __init__(self, dialogue: ClientProtocol, columns: Sequence[str]) -> None:
        self.refused: list[str] = []
        self._dialogue = dialogue
        self._columns = list(columns)
        self._move = 0
        self._at_once = 1
        self._batch: list[list[float]] = []

    def begin(self) -> Steps[None]:
        """Ask for the stream."""
        begun = yield Ask("move", {"columns": self._columns})
        self._move = int(begun["move"])
        # Without times every row is the target at once; with them the rows are played after the last.
        self._at_once = min(int(begun["credits"]), ROWS_AT_ONCE) if begun["timed"] else 1

    def add(self, row: Sequence[float]) -> Steps[None]:
        """One more row."""
        self._batch.append(list(row))
        if len(self._batch) >= self._at_once:
            yield from self._send()

    def end(self, wait: bool) -> Steps[None]:
        """No further row; wait for the end of the move."""
        if self._batch:
            yield from self._send()
        yield Ask("end", {"move": self._move})
        if wait:
            yield from arrival(self._dialogue, self._move)

    def _send(self) -> Steps[None]:
        while self._dialogue.credits.get(self._move, 0) < len(self._batch):
            yield from listen(self._dialogue)
            if self._dialogue.arrived(self._move):
                break  # the daemon says what it thinks of further rows
        told = yield Ask("rows", {"move": self._move, "rows": self._batch})
        self.refused += told["refused"]
        self._batch = []


def subscription(rate_hz: float, robots: Robots, fields: Sequence[str] | None, events: bool) -> Fields:
    """The fields of ``subscribe``."""
    wanted = list(fields) if fields else None
    return {"rate_hz": rate_hz, "robots": list_of(robots), "fields": wanted, "events": events}


def measurement(
    tip_mm: Sequence[float],
    direction: Sequence[float] | None,
    robot: str | None,
    age_ms: float | None,
    time_s: float | None,
) -> Fields:
    """The fields of ``measure``; numbers of NumPy become Python's own."""
    return {
        "robot": robot,
        "tip_mm": [float(value) for value in tip_mm],
        "direction": None if direction is None else [float(value) for value in direction],
        "age_ms": None if age_ms is None else float(age_ms),
        "time_s": None if time_s is None else float(time_s),
    }


def list_of(robots: Robots) -> list[str] | None:
    """One robot, several, or None for all of them."""
    if robots is None:
        return None
    return [robots] if isinstance(robots, str) else list(robots)
