"""The moves of clients - to a point, along live rows, along a timed trajectory - and how many rows may come.

A live stream (no column ``t_s``) makes its newest row the target; its credit refills at the rate of the tick:
a client cannot send faster than rows can be followed. Rows of a timed trajectory are only collected.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, TypeAlias

from contid.remote.protocol.wire import Code, Fields, RemoteError
from contid.targets import Target
from contid.trajectory.rows import RowReader

#: Greatest credit of a live stream: rows that may come in one burst.
LIVE_ROWS: Final = 8
#: The most rows of one request of a timed trajectory.
TIMED_ROWS: Final = 1024
#: Rows of a timed trajectory in all: 250 s at 200 Hz. `contid.remote.server.moves.Moves.rows` refuses more.
MAX_ROWS: Final = 50_000

#: Sends a notice to the client of a move.
Notify: TypeAlias = Callable[[Mapping[str, Any]], None]


class Credit:
    """How many rows of a live stream may be sent now."""

    def __init__(self, rate_hz: float, now_s: float) -> None:
        self._rate_hz = rate_hz
        self._rows: float = LIVE_ROWS
        self._grown_s = now_s
        self._spent = 0

    @property
    def fields(self) -> Fields:
        """Rows that may be sent now, and in all, those that came included.

        A client that counts what it has sent need not wait for responses: the number in all never falls, as
        what is spent was credit before.
        """
        rows = int(self._rows)
        return {"credits": rows, "granted": self._spent + rows}

    def spend(self, rows: int, now_s: float) -> None:
        """Account for received rows.

        Raises:
            RemoteError: more than the credit.
        """
        self._grow(now_s)
        check_credit(rows, int(self._rows))
        self._rows -= rows
        self._spent += rows

    def refilled(self, now_s: float) -> bool:
        """True when a waiting client may send again: at half the credit, not row by row.

        Only the call in which the credit gets there is true; later the responses to rows have the credit.
        """
        if self._rows >= LIVE_ROWS / 2:
            return False
        self._grow(now_s)
        return self._rows >= LIVE_ROWS / 2

    def _grow(self, now_s: float) -> None:
        self._rows = min(self._rows + (now_s - self._grown_s) * self._rate_hz, LIVE_ROWS)
        self._grown_s = now_s


def check_credit(rows: int, allowed: int) -> None:
    """Refuse more rows than are allowed."""
    if rows > allowed:
        raise RemoteError(Code.NO_CREDIT, f"{rows} rows sent, {allowed} allowed; wait for credit")


@dataclass(slots=True, eq=False)
class Move:
    """A move in progress.

    Attributes:
        number: identifies the move in requests and notices.
        client: number of the client that owns it.
        notify: sends a notice to the owner.
        waiting: robots whose goto has not ended.
        failed: robots whose goto was dropped.
        reasons: by robot why it was, where that is known.
        refused: its client got an error instead of the move, so it gets no end.
    """

    number: int
    client: int
    notify: Notify
    waiting: set[str] = field(default_factory=set, init=False)
    failed: set[str] = field(default_factory=set, init=False)
    reasons: dict[str, str] = field(default_factory=dict, init=False)
    refused: bool = field(default=False, init=False)

    def end(self, reached: bool, message: str, faults: Mapping[str, Fields] | None = None) -> None:
        """Notify the owner of the end."""
        notice: Fields = {"event": "move", "move": self.number, "reached": reached, "message": message}
        self.notify({**notice, "faults": dict(faults)} if faults else notice)


@dataclass(slots=True, eq=False)
class LiveMove(Move):
    """A live stream; rows may come until it ends.

    Attributes:
        reader: of its rows.
        credit: for further rows.
        nearest: steps that lead out of reach go along its edge.
        count: rows received.
        last: newest target of every robot, within reach.
    """

    reader: RowReader
    credit: Credit
    nearest: bool
    count: int = 0
    last: dict[str, Target] = field(default_factory=dict)

    @property
    def open(self) -> bool:
        """True while rows may come."""
        return True


class Phase(enum.Enum):
    """Where a timed trajectory is; `contid.remote.server.moves` has what leads from one to the next."""

    COLLECTED = "its rows come in"
    CHECKED = "the daemon checks it and sends it to the tick"
    WAITS = "the tick has it, and begins when it is started"
    PLAYED = "the tick follows it"


@dataclass(slots=True, eq=False)
class TimedMove(Move):
    """A timed trajectory: the reader of its rows, its rows in the units of their columns, and its phase.

    Attributes:
        faulted: a robot went to FAULT since it was sent to the tick.
    """

    reader: RowReader
    rows: list[Sequence[float]] = field(default_factory=list)
    phase: Phase = Phase.COLLECTED
    faulted: bool = False

    @property
    def open(self) -> bool:
        """True while rows may come."""
        return self.phase is Phase.COLLECTED
