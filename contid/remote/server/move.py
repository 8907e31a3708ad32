"""One move of a client, and the credit under which its rows may be sent.

A live stream (no column ``t_s``) makes its newest row the target; its credit is a bucket of `LIVE_ROWS` that
refills at the rate of the tick, so that a client cannot send faster than rows can be followed. The rows of a
timed trajectory are only collected: their credit bounds what is under way.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, TypeAlias

from contid.remote.protocol.wire import Code, Fields, RemoteError
from contid.targets import Target
from contid.trajectory.rows import RowReader

#: Rows of a live stream that may be under way: a burst of so many ticks.
LIVE_ROWS: Final = 8
#: Rows of a timed trajectory that may be under way.
TIMED_ROWS: Final = 1024

#: Tells the owner of a move about it.
Notify: TypeAlias = Callable[[Mapping[str, Any]], None]


class Credit:
    """How many rows may be sent now."""

    def __init__(self, timed: bool, rate_hz: float, now_s: float) -> None:
        self._timed = timed
        self._rate_hz = rate_hz
        self._rows: float = TIMED_ROWS if timed else LIVE_ROWS
        self._grown_s = now_s

    @property
    def rows(self) -> int:
        """Whole rows."""
        return int(self._rows)

    def spend(self, rows: int, now_s: float) -> None:
        """Rows were sent.

        Raises:
            RemoteError: more than may be.
        """
        self._grow(now_s)
        if rows > self.rows:
            raise RemoteError(Code.NO_CREDIT, f"{rows} rows sent, {self.rows} allowed; wait for credit")
        if not self._timed:  # rows that are only collected are done with at once
            self._rows -= rows

    def came_back(self, now_s: float) -> bool:
        """True when a client that had to wait may send again: at half a bucket, not row by row."""
        if self._rows >= LIVE_ROWS / 2:
            return False
        self._grow(now_s)
        return self._rows >= LIVE_ROWS / 2

    def _grow(self, now_s: float) -> None:
        if not self._timed:
            self._rows = min(self._rows + (now_s - self._grown_s) * self._rate_hz, LIVE_ROWS)
        self._grown_s = now_s


@dataclass(slots=True, eq=False)
class Move:
    """A move that was begun.

    Attributes:
        number: its name on the socket.
        client: whose it is.
        notify: reaches its owner.
        waiting: robots whose goto has not ended.
        failed: robots whose goto was dropped.
        closed: no further row may come.
    """

    number: int
    client: int
    notify: Notify
    waiting: set[str] = field(default_factory=set)
    failed: set[str] = field(default_factory=set)
    closed: bool = False

    def end(self, reached: bool, message: str, faults: Mapping[str, Fields] | None = None) -> None:
        """It is over; its owner is told."""
        self.closed = True
        told: Fields = {"event": "move", "move": self.number, "reached": reached, "message": message}
        self.notify({**told, "faults": dict(faults)} if faults else told)


@dataclass(slots=True, eq=False, kw_only=True)
class RowMove(Move):
    """A move along rows.

    Attributes:
        parser: of the rows.
        credit: for further ones.
        lines: header and rows of a timed trajectory, as text.
        rows: how many came.
        last: newest good target of every robot of a live stream.
        playing: a timed trajectory is being followed.
    """

    parser: RowReader
    credit: Credit
    lines: list[str]
    rows: int = 0
    last: dict[str, Target] = field(default_factory=dict)
    playing: bool = False
