"""The moves of the lease holder: to points, along live rows, along timed trajectories.

A move to a point is a goto of every robot that it names, which `Gotos` follows to its end. Of moves along
rows there is one at a time, the current one. A live stream forwards its rows (`LiveRows`) until its ``end``,
and its last row is then a goto. A timed trajectory is checked as a whole like a file, and played by the tick:

    phase      request, or report of the tick         leads to
    COLLECTED  ``rows``                               COLLECTED; ended, if there are too many
               ``end``                                CHECKED
    CHECKED    the tick has it and all robots follow  PLAYED; with ``hold_at_start`` WAITS; ended, if refused
    WAITS      ``start``                              WAITS, on the way to the first row
               ``start`` at a time                    WAITS, and the tick begins then
               it begins (an order "go")              PLAYED
               `NOT_AT_START`                         ended
    PLAYED     `SourceEnded`, or all its robots       ended
               are in FAULT

What the table does not have is refused. Another move, a stop, or the loss of the lease ends a move in every
phase (`abort`). Requests of one client overlap: after each ``await`` the move may be the current one no more.
"""

from __future__ import annotations

import asyncio
import itertools
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any, Final

from contid.control.daemon.interfaces import RunControl
from contid.control.engine.events import RunEvent
from contid.control.engine.events.robots import (
    FaultLatched,
    GotoEnded,
    OrderGiven,
    OrderRefused,
    SqueezeChanged,
)
from contid.control.engine.events.run import SourceEnded
from contid.control.engine.messages import NOT_AT_START, Begin, Follow, Message, Play, Rows, Start
from contid.control.engine.tick_layout import TickRecord
from contid.control.tick.supervisor import Mode
from contid.remote.protocol.expiry import unpaused
from contid.remote.protocol.wire import Code, Fields, RemoteError
from contid.remote.server.checks import ClientTurns, MoveChecks, end_turn
from contid.remote.server.gotos import Gotos
from contid.remote.server.live_rows import LiveRows
from contid.remote.server.move import (
    MAX_ROWS,
    TIMED_ROWS,
    Credit,
    LiveMove,
    Move,
    Notify,
    Phase,
    TimedMove,
    check_credit,
)  # fmt: skip
from contid.remote.server.pending_orders import CONFIRM_TIMEOUT_S, OrderResult, PendingOrders
from contid.remote.server.preconditions import Preconditions
from contid.remote.server.standstill import checked_at_rest
from contid.remote.server.telemetry_view import TelemetryView
from contid.trajectory.timed import Trajectory

#: How far ahead a start may lie.
MIN_LEAD_S: Final = 0.2
MAX_LEAD_S: Final = 60.0
#: The control process loads a long trajectory before it confirms it.
PLAY_TIMEOUT_S: Final = 30.0
_TIMED_CREDIT: Final = {"credits": TIMED_ROWS, "granted": MAX_ROWS}


class Moves:
    """The moves in progress.

    Attributes:
        turns: of orders that are checked before they are sent.
    """

    def __init__(self, control: RunControl, view: TelemetryView, pending: PendingOrders) -> None:
        self._control = control
        self._view = view
        self._pending = pending
        self._preconditions = Preconditions(control, view)
        self._checks = MoveChecks(control.loaded)
        self.turns = ClientTurns()
        self._live_rows = LiveRows(view, self._preconditions)
        self._numbers = itertools.count(1)
        self._gotos = Gotos(control, view, pending)
        self._current: LiveMove | TimedMove | None = None

    # -- requests ----------------------------------------------------------------------------------------

    async def point(
        self, client: int, target: Mapping[str, Any], notify: Notify, until_force_n: float | None = None
    ) -> Fields:
        """Start a goto, or a closing until a force; returns when the control process has accepted it."""
        targets = self._preconditions.point(target)
        self._preconditions.armed(tuple(targets))
        preconditions = self._preconditions
        if unreachable := await self._checks.short(
            "move", preconditions.asked(targets), preconditions.unreachable, targets, self._control.newest()
        ):
            raise RemoteError(Code.UNREACHABLE, "; ".join(unreachable.values()))
        preconditions.armed(tuple(targets))  # the check may have taken long
        end_turn()
        if self._current is not None and self._current.client == client:
            self.abort("another move began")
        move = Move(next(self._numbers), client, notify)
        return await self._gotos.begin(move, targets, until_force_n=until_force_n)

    async def begin(
        self, client: int, columns: Sequence[str], notify: Notify, nearest: bool = False
    ) -> Fields:
        """Begin a move along rows; the result grants the first credit. For ``nearest`` see `LiveMove`."""
        reader = self._preconditions.reader(columns, "rows")
        self._preconditions.armed(reader.robots)
        self.abort("another move began")
        number = next(self._numbers)
        if reader.timed:
            self._current = TimedMove(number, client, notify, reader)
            return {"move": number, "timed": True, **_TIMED_CREDIT}
        credit = Credit(self._control.rate_hz, asyncio.get_running_loop().time())
        self._current = move = LiveMove(number, client, notify, reader, credit, nearest)
        with self._ended_by_refusal(move):
            await self._obeyed(reader.robots, Begin(), Follow(reader.robots))
        return {"move": number, "timed": False, **credit.fields}

    async def rows(self, client: int, number: int, rows: Sequence[Sequence[float]]) -> Fields:
        """Take rows; robots of a refused row of a live stream hold."""
        move = self._open_move(client, number)
        if isinstance(move, TimedMove):
            check_credit(len(rows), TIMED_ROWS)
            move.rows += rows
            if len(move.rows) > MAX_ROWS:
                self.abort("too long")
                message = f"more than {MAX_ROWS} rows; send the trajectory in pieces"
                raise RemoteError(Code.BAD_TARGET, message)
            return {**_TIMED_CREDIT, "refused": []}
        move.credit.spend(len(rows), asyncio.get_running_loop().time())
        refused: list[str] = []
        reached: dict[str, float] = {}
        asked, check = self._preconditions.asked(move.reader.robots), self._live_rows.check
        for row in rows:
            checked = await self._checks.short("rows", asked, check, move, row, self._control.newest())
            self._check_current(move)
            self._control.send(Rows(checked.targets))
            refused += checked.refused
            reached |= checked.reached
        return {**move.credit.fields, "refused": refused, **({"reached": reached} if reached else {})}

    async def end(self, client: int, number: int, hold_at_start: bool = False) -> Fields:
        """End the rows: a live stream ends on its last one, a timed trajectory is checked and played.

        With ``hold_at_start`` a timed trajectory is checked, and nothing moves before `start`.
        """
        move = self._open_move(client, number)
        if isinstance(move, TimedMove):
            with self._ended_by_refusal(move):
                async with unpaused("end") as check_pause:
                    return await self._play(move, hold_at_start, check_pause)
        if hold_at_start:
            raise RemoteError(Code.BAD_TARGET, "a live stream has no start to hold at: rows need t_s")
        self._current = None
        if move.last:
            return await self._gotos.begin(move, move.last, [Begin()])
        self._control.send(Begin())
        move.end(True, "the stream had no rows")
        return {"move": number}

    async def _play(self, move: TimedMove, waits: bool, check_pause: Callable[[], None]) -> Fields:
        """Check a timed trajectory as a whole and let the tick follow it, unless the daemon stood still."""
        move.phase = Phase.CHECKED
        robots, preconditions = move.reader.robots, self._preconditions
        asked = preconditions.asked(robots)

        async def check(record: TickRecord | None) -> Trajectory:
            return await self._checks.long(asked, preconditions.trajectory, move.reader, move.rows, record)

        trajectory = await checked_at_rest(
            self._control, self._view, self._pending, check, partial(self._check_current, move)
        )
        self._check_current(move)
        preconditions.armed(robots)  # the check and the standstill take seconds
        check_pause()
        await self._obeyed(robots, Play(trajectory, waits), timeout_s=PLAY_TIMEOUT_S)
        self._check_current(move)
        check_pause()
        move.phase = Phase.WAITS if waits else Phase.PLAYED
        result: Fields = {"move": move.number, "duration_s": trajectory.end_s - trajectory.start_s}
        if waits:
            return result
        outcome = await self._obeyed(robots, Follow(robots))
        return {**result, "tick": outcome.tick}

    async def start(self, client: int, number: int, at_s: float | None) -> Fields:
        """Go to the first row of a trajectory that waits; with a time, begin then."""
        move = self._current
        if (
            not isinstance(move, TimedMove)
            or (move.number, move.client) != (number, client)
            or move.phase is not Phase.WAITS
        ):
            message = f"move {number} does not wait for a start; it ended or was stopped"
            raise RemoteError(Code.REFUSED, message)
        robots = move.reader.robots
        if at_s is None:
            self._preconditions.armed(robots)
            outcome = await self._obeyed(robots, Follow(robots))
            return {"move": number, "tick": outcome.tick, "robots": list(robots)}
        lead_s = at_s - time.monotonic()
        if not MIN_LEAD_S <= lead_s <= MAX_LEAD_S:
            message = f"at_s: {MIN_LEAD_S:g} to {MAX_LEAD_S:g} s ahead is expected, got {lead_s:.3f}"
            raise RemoteError(Code.BAD_REQUEST, message)
        record = self._control.newest()
        if away := [name for name in robots if self._view.mode(name, record) is not Mode.RUN]:
            message = f"{', '.join(away)}: not at the first row; start without at_s first"
            raise RemoteError(Code.REFUSED, message)
        outcome = await self._obeyed(robots, Start(at_s))
        return {"move": number, "tick": outcome.tick, "at_s": at_s}

    # -- state of the current move -----------------------------------------------------------------------

    @property
    def open(self) -> bool:
        """True while a client may send rows."""
        return self._current is not None and self._current.open

    def along_rows(self, client: int) -> bool:
        """True while a client has a move along rows."""
        return self._current is not None and self._current.client == client

    def watch(self) -> None:
        """Grant the credit that has grown with time; end a trajectory whose robots are all in FAULT."""
        move = self._current
        if isinstance(move, LiveMove) and move.credit.refilled(asyncio.get_running_loop().time()):
            move.notify({"event": "credit", "move": move.number, **move.credit.fields})
        elif isinstance(move, TimedMove) and move.faulted and move.phase is Phase.PLAYED:
            record, robots = self._control.newest(), move.reader.robots
            if all(self._view.mode(name, record) is Mode.FAULT for name in robots):
                self.abort(f"{', '.join(robots)} did not arrive", self._view.faults(record, robots))

    def abort(self, message: str, faults: Mapping[str, Fields] | None = None) -> None:
        """End checks, and the move along rows before its end, if there is one; gotos notify their own end."""
        self._checks.end(message)
        move, self._current = self._current, None
        if move is not None:
            # Without targets a later resume arms the robots and does not move them.
            self._control.send(Begin())
            move.end(False, message, faults)

    def stop(self, message: str) -> None:
        """End also orders that wait for their turn: the robots are stopped, or another client moves them."""
        self.turns.end(message)
        self.abort(message)

    def notice(self, event: RunEvent) -> None:
        """Take in an event of the ring."""
        move = self._current if isinstance(self._current, TimedMove) else None
        if isinstance(event, SqueezeChanged):
            self._gotos.squeezed(event)
        elif isinstance(event, GotoEnded):
            self._gotos.ended(event)
        elif isinstance(event, SourceEnded) and move is not None and move.phase is Phase.PLAYED:
            self._current = None
            self._control.send(Begin())
            faults = self._view.faults(self._control.newest(), move.reader.robots)
            move.end(not faults, f"{', '.join(faults)} did not arrive" if faults else "", faults)
        elif isinstance(event, FaultLatched) and move is not None:
            move.faulted = True
        elif isinstance(event, OrderRefused) and event.message == NOT_AT_START:
            self.abort(event.message)
        elif isinstance(event, OrderGiven) and event.order["order"] == "go" and move is not None:
            move.phase = Phase.PLAYED
            began = {key: event.order[key] for key in ("at_s", "began_s")}
            move.notify({"event": "started", "move": move.number, "tick": event.tick, **began})

    # -- helpers -----------------------------------------------------------------------------------------

    async def _obeyed(
        self, robots: tuple[str, ...], *orders: Message, timeout_s: float = CONFIRM_TIMEOUT_S
    ) -> OrderResult:
        """Send orders for robots; returns when the control process has carried them out.

        Raises:
            RemoteError: a robot refused, or nothing was confirmed in time.
        """
        outcome = await self._pending.confirmed(self._pending.send(orders), timeout_s)
        if outcome.refused:
            raise outcome.refusal(self._view.faults(self._control.newest(), robots))
        return outcome

    @contextmanager
    def _ended_by_refusal(self, move: LiveMove | TimedMove) -> Iterator[None]:
        """End a move, if it is still the current one, when a step towards its motion is refused."""
        try:
            yield
        except RemoteError as error:
            if self._current is move:
                self.abort(str(error))
            raise

    def _open_move(self, client: int, number: int) -> LiveMove | TimedMove:
        move = self._current
        if move is None or (move.number, move.client) != (number, client) or not move.open:
            raise RemoteError(Code.REFUSED, f"move {number} is not open; it ended or was stopped")
        return move

    def _check_current(self, move: LiveMove | TimedMove) -> None:
        if self._current is not move:
            raise RemoteError(Code.STOPPED, "the robots were stopped meanwhile; nothing was played")
