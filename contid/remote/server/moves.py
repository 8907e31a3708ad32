"""The moves of the lease holder: points, and trajectories row by row under credit.

A point becomes a goto of every robot that it names. Rows of a live stream are forwarded one by one. A timed
trajectory is collected, checked as a whole like a file, and then played by the tick.
"""

from __future__ import annotations

import asyncio
import itertools
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from contid.control.daemon.interfaces import RunControl
from contid.control.engine.events import RunEvent
from contid.control.engine.events.robots import GotoEnded, OrderGiven, OrderRefused, SqueezeChanged
from contid.control.engine.events.run import SourceEnded
from contid.control.engine.messages import NOT_AT_START, Begin, Hold, Play, Resume, Rows, Start
from contid.control.tick.supervisor import Mode
from contid.errors import BadInputError
from contid.remote.protocol.expiry import unpaused
from contid.remote.protocol.wire import Code, Fields, RemoteError, is_number
from contid.remote.server.gotos import Gotos
from contid.remote.server.move import MAX_ROWS, Credit, Move, Notify, RowMove
from contid.remote.server.pending_orders import BULK_TIMEOUT_S, PendingOrders
from contid.remote.server.preconditions import Preconditions, bad_target
from contid.remote.server.standstill import commands, standstill
from contid.remote.server.telemetry_view import TelemetryView
from contid.targets import Target
from contid.trajectory.rows import RowReader

#: Columns of a move. A laboratory of sixteen fingers has 200; thousands would hold up the other clients.
MAX_COLUMNS: Final = 500
#: How far ahead a start may lie.
MIN_LEAD_S: Final = 0.2
MAX_LEAD_S: Final = 60.0


class Moves:
    """The moves in progress."""

    def __init__(self, control: RunControl, view: TelemetryView, pending: PendingOrders) -> None:
        self._control = control
        self._view = view
        self._pending = pending
        self._preconditions = Preconditions(control, view)
        self._numbers = itertools.count(1)
        self._gotos = Gotos(control, view, pending)
        self._stream: RowMove | None = None

    # -- points ------------------------------------------------------------------------------------------

    async def point(
        self, client: int, target: Mapping[str, Any], notify: Notify, until_force_n: float | None = None
    ) -> Fields:
        """Start a goto, or a closing until a force; returns when the control process has accepted it."""
        try:
            header = _header(target)
            for name, value in target.items():
                if not is_number(value):
                    raise RemoteError(Code.BAD_TARGET, f"{name[:60]}: {str(value)[:40]!r} is not a number")
            reader = RowReader(header, "move", self._view.robots)
            targets = reader.layout.targets(reader.row(tuple(target.values()), 1))
        except BadInputError as error:
            raise bad_target(error) from None
        if reader.timed:
            raise RemoteError(Code.BAD_TARGET, "a point has no time; stream rows with columns for that")
        self._preconditions.armed(tuple(targets))
        unreachable = self._preconditions.unreachable(targets)
        if unreachable:
            raise RemoteError(Code.UNREACHABLE, "; ".join(unreachable.values()))
        if self._stream is not None and self._stream.client == client:
            self.abort(self._stream, "another move began")
        move = Move(next(self._numbers), client, notify)
        return await self._gotos.begin(move, targets, until_force_n=until_force_n)

    # -- streams -----------------------------------------------------------------------------------------

    async def begin(
        self, client: int, columns: Sequence[str], notify: Notify, nearest: bool = False
    ) -> Fields:
        """Begin a stream of rows; the result grants the first credit.

        With ``nearest`` a step that leads out of reach goes along its edge (`Preconditions.edges`).
        """
        try:
            reader = RowReader(_header(columns), "rows", self._view.robots)
        except BadInputError as error:
            raise bad_target(error) from None
        self._preconditions.armed(reader.robots)
        self.abort_streams("another move began")
        credit = Credit(reader.timed, self._control.rate_hz, asyncio.get_running_loop().time())
        move = RowMove(next(self._numbers), client, notify, reader=reader, credit=credit, nearest=nearest)
        self._stream = move
        if not reader.timed:
            await self._pending.confirmed(self._pending.send([Begin(), Resume(reader.robots)]))
        return {"move": move.number, "timed": reader.timed, **_credit(move)}

    def rows(self, client: int, number: int, rows: Sequence[Sequence[float]]) -> Fields:
        """Take rows of the stream; robots of a refused row hold."""
        move = self._open_stream(client, number)
        move.credit.spend(len(rows), asyncio.get_running_loop().time())
        refused: list[str] = []
        reached: dict[str, float] = {}
        if move.reader.timed:
            move.timed_rows += rows
            if len(move.timed_rows) > MAX_ROWS:
                self.abort(move, "too long")
                message = f"more than {MAX_ROWS} rows; send the trajectory in pieces"
                raise RemoteError(Code.BAD_TARGET, message)
        else:
            for row in rows:
                refused += self._follow(move, row, reached)
        return {**_credit(move), "refused": refused, **({"reached": reached} if reached else {})}

    def _follow(self, move: RowMove, row: Sequence[float], reached: dict[str, float]) -> list[str]:
        """Forward a row of a live stream; returns messages about what is refused.

        ``reached`` gets the columns that go elsewhere than the row states.
        """
        move.count += 1
        try:
            targets: dict[str, Target | None] = {
                **move.reader.layout.targets(move.reader.row(row, move.count))
            }
        except BadInputError as error:
            self._control.send(Rows(dict.fromkeys(move.reader.robots)))
            return [str(error)]
        unreachable = self._preconditions.unreachable(targets)
        if move.nearest:
            unreachable = self._preconditions.beside(targets, move.last) | unreachable
        if move.nearest and unreachable:
            edges = self._preconditions.edges(targets, move.last, unreachable)
            unreachable = {name: why for name, why in unreachable.items() if name not in edges}
            targets |= edges
            reached |= move.reader.layout.moved_mm(edges)
        targets |= dict.fromkeys(unreachable)
        move.last |= {name: target for name, target in targets.items() if target is not None}
        self._control.send(Rows(targets))
        return [f"rows:{move.count}: {message}" for message in unreachable.values()]

    async def end(self, client: int, number: int, hold_at_start: bool = False) -> Fields:
        """End the rows: a live stream ends on its last one, a timed trajectory is checked and played.

        With ``hold_at_start`` a timed trajectory is checked, and nothing moves before `start`.
        """
        move = self._open_stream(client, number)
        if hold_at_start and not move.reader.timed:
            raise RemoteError(Code.BAD_TARGET, "a live stream has no start to hold at: rows need t_s")
        move.closed, move.waits = True, hold_at_start
        if move.reader.timed:
            try:
                async with unpaused("end") as check_pause:
                    return await self._play(move, check_pause)
            except RemoteError as error:
                if error.code == Code.EXPIRED and self._stream is move:
                    self.abort(move, str(error))
                raise
        self._stream = None
        if move.last:
            return await self._gotos.begin(move, move.last, [Begin()])
        self._control.send(Begin())
        move.end(True, "the stream had no rows")
        return {"move": move.number}

    async def _play(self, move: RowMove, check_pause: Callable[[], None]) -> Fields:
        """Check a timed trajectory as a whole and let the tick follow it, unless the daemon stood still."""
        # In a thread: the check of a large one would delay the response to a stop.
        record = self._control.newest()
        check = self._preconditions.trajectory
        trajectory = await asyncio.to_thread(check, move.reader, move.timed_rows, record)
        robots = tuple(trajectory.targets_of_row(0))
        await self._pending.confirmed(self._pending.send([Hold()]))
        stands = await standstill(self._control, self._view)
        if commands(self._view, stands) != commands(self._view, record):
            # They moved while it was checked: which answers a robot reaches depends on where it stands.
            trajectory = await asyncio.to_thread(check, move.reader, move.timed_rows, stands)
        self._not_stopped(move)
        self._preconditions.armed(robots)  # the check and the standstill take seconds
        check_pause()
        await self._pending.confirmed(self._pending.send_bulk(Play(trajectory, move.waits)), BULK_TIMEOUT_S)
        if self._stream is None:  # a stop has overtaken it: a later resume must not follow it
            self._control.send(Begin())
        self._not_stopped(move)
        check_pause()
        move.playing = True
        result: Fields = {"move": move.number, "duration_s": trajectory.end_s - trajectory.start_s}
        if move.waits:
            return result
        outcome = await self._pending.confirmed(self._pending.send([Resume(robots)]))
        return {**result, "tick": outcome.tick}

    async def start(self, client: int, number: int, at_s: float | None) -> Fields:
        """Go to the first row of a trajectory that waits; with a time, begin then."""
        move = self._stream
        if (
            move is None
            or (move.number, move.client) != (number, client)
            or not (move.playing and move.waits)
        ):
            raise RemoteError(
                Code.REFUSED, f"move {number} does not wait for a start; it ended or was stopped"
            )
        robots = move.reader.robots
        if at_s is None:
            self._preconditions.armed(robots)
            outcome = await self._pending.confirmed(self._pending.send([Resume(robots)]))
            return {"move": number, "tick": outcome.tick, "robots": list(robots)}
        lead_s = at_s - time.monotonic()
        if not MIN_LEAD_S <= lead_s <= MAX_LEAD_S:
            message = f"at_s: {MIN_LEAD_S:g} to {MAX_LEAD_S:g} s ahead is expected, got {lead_s:.3f}"
            raise RemoteError(Code.BAD_REQUEST, message)
        record = self._control.newest()
        if away := [name for name in robots if self._view.mode(name, record) is not Mode.RUN]:
            raise RemoteError(
                Code.REFUSED, f"{', '.join(away)}: not at the first row; start without at_s first"
            )
        outcome = await self._pending.confirmed(self._pending.send([Start(at_s)]))
        if outcome.refused:
            raise RemoteError(Code.REFUSED, "; ".join(outcome.refused.values()))
        return {"move": number, "tick": outcome.tick, "at_s": at_s}

    @property
    def open(self) -> bool:
        """True while a client may send rows."""
        return self._stream is not None and not self._stream.closed

    def refill(self) -> None:
        """Grant the credit that has grown with time; called periodically."""
        move = self._stream
        if move is None or move.closed:
            return
        if move.credit.refilled(asyncio.get_running_loop().time()):
            move.notify({"event": "credit", "move": move.number, **_credit(move)})

    # -- ends --------------------------------------------------------------------------------------------

    def abort_streams(self, message: str) -> None:
        """End the stream or the played trajectory; gotos notify their own end."""
        if self._stream is not None:
            self.abort(self._stream, message)

    def abort(self, move: RowMove, message: str) -> None:
        """End a stream or a played trajectory before its end."""
        if self._stream is move:
            self._stream = None
        # Without targets a later resume arms the robots and does not move them.
        self._control.send(Begin())
        move.end(False, message)

    def streaming(self, client: int) -> bool:
        """True while a client streams, or its trajectory is played."""
        move = self._stream
        return move is not None and move.client == client and (move.playing or not move.closed)

    def notice(self, event: RunEvent) -> None:
        """Take in an event of the ring."""
        if isinstance(event, SqueezeChanged):
            self._gotos.squeezed(event)
        elif isinstance(event, GotoEnded):
            self._gotos.ended(event)
        elif isinstance(event, SourceEnded) and self._stream is not None and self._stream.playing:
            played, self._stream = self._stream, None
            self._control.send(Begin())
            faults = self._view.faults(self._control.newest(), played.reader.robots)
            played.end(not faults, f"{', '.join(faults)} did not arrive" if faults else "", faults)
        elif isinstance(event, OrderRefused) and event.message == NOT_AT_START and self._stream is not None:
            self.abort(self._stream, event.message)
        elif isinstance(event, OrderGiven) and event.order["order"] == "go" and self._stream is not None:
            self._stream.waits = False
            notice = {key: event.order[key] for key in ("at_s", "began_s")}
            self._stream.notify(
                {"event": "started", "move": self._stream.number, "tick": event.tick, **notice}
            )

    # -- helpers -----------------------------------------------------------------------------------------

    def _open_stream(self, client: int, number: int) -> RowMove:
        move = self._stream
        if move is None or move.number != number or move.client != client or move.closed:
            raise RemoteError(Code.REFUSED, f"move {number} is not open; it ended or was stopped")
        return move

    def _not_stopped(self, move: RowMove) -> None:
        if self._stream is not move:
            raise RemoteError(Code.STOPPED, "the robots were stopped meanwhile; nothing was played")


def _credit(move: RowMove) -> Fields:
    """Credit left, and rows granted in all."""
    return {"credits": move.credit.rows, "granted": move.credit.granted}


def _header(columns: Sequence[str] | Mapping[str, Any]) -> str:
    """Names of columns as the header of a CSV."""
    if len(columns) > MAX_COLUMNS:
        raise RemoteError(Code.BAD_TARGET, f"{len(columns)} columns; a move has at most {MAX_COLUMNS}")
    if any("," in name or "\n" in name or name.startswith(("{", "#")) for name in columns):
        raise RemoteError(Code.BAD_TARGET, "a column is one name, such as x_mm or left.x_mm")
    return ",".join(columns)
