"""One move of a client, and the credit that limits its rows.

A live stream (no column ``t_s``) makes its newest row the target; its credit refills at the rate of the tick:
a client cannot send faster than rows can be followed. Rows of a timed trajectory are only collected.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, TypeAlias

from contid.remote.protocol.wire import Code, Fields, RemoteError
from contid.targets import Target
from contid.trajectory.rows import RowReader

#: Greatest credit of a live stream: rows that may come in one burst.
LIVE_ROWS: Final = 8
#: Credit of a timed trajectory, which is not spent: the most rows of one request.
TIMED_ROWS: Final = 1024
#: Rows of a timed trajectory in all: 250 s at 200 Hz. `contid.remote.server.moves.Moves.rows` refuses more.
MAX_ROWS: Final = 50_000

#: Sends a notice to the client of a move.
Notify: TypeAlias = Callable[[Mapping[str, Any]], None]


class Credit:
    """How many rows may be sent now."""

    def __init__(self, timed: bool, rate_hz: float, now_s: float) -> None:
        self._timed = timed
        self._rate_hz = rate_hz
        self._rows: float = TIMED_ROWS if timed else LIVE_ROWS
        self._grown_s = now_s
        self._spent = 0

    @property
    def granted(self) -> int:
        """Rows that may be sent in all, those that came included.

        A client that counts what it has sent need not wait for responses. Of a live stream the number never
        falls: what is spent was credit before.
        """
        return MAX_ROWS if self._timed else self._spent + self.rows

    @property
    def rows(self) -> int:
        """Whole rows of credit left."""
        return int(self._rows)

    def spend(self, rows: int, now_s: float) -> None:
        """Account for received rows.

        Raises:
            RemoteError: more than the credit.
        """
        self._grow(now_s)
        if rows > self.rows:
            raise RemoteError(Code.NO_CREDIT, f"{rows} rows sent, {self.rows} allowed; wait for credit")
        if not self._timed:  # collected rows are processed at once
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
        if not self._timed:
            self._rows = min(self._rows + (now_s - self._grown_s) * self._rate_hz, LIVE_ROWS)
        self._grown_s = now_s


@dataclass(slots=True, eq=False)
class Move:
    """A move in progress.

    Attributes:
        number: identifies the move in requests and notices.
        client: number of the client that owns it.
        notify: sends a notice to the owner.
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
        """End the move and notify its owner."""
        self.closed = True
        notice: Fields = {"event": "move", "move": self.number, "reached": reached, "message": message}
        self.notify({**notice, "faults": dict(faults)} if faults else notice)


@dataclass(slots=True, eq=False, kw_only=True)
class RowMove(Move):
    """A move along rows.

    Attributes:
        reader: of the rows.
        credit: for further rows.
        count: rows received.
        timed_rows: of a timed trajectory, in the units of the columns.
        last: newest good target of every robot of a live stream.
        playing: the tick follows the timed trajectory.
        waits: it does not begin before it is started.
        nearest: steps that lead out of reach go along its edge.
    """

    reader: RowReader
    credit: Credit
    count: int = 0
    timed_rows: list[Sequence[float]] = field(default_factory=list)
    last: dict[str, Target] = field(default_factory=dict)
    playing: bool = False
    waits: bool = False
    nearest: bool = False
