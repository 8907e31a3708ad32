"""What the holder of the lease moves: points, and trajectories row by row under credit.

A point becomes a goto of every robot it names. The rows of a live stream are sent on one by one
(`contid.remote.server.move`). A timed trajectory is collected, checked as a whole like a file, and then
played by
the tick itself.
"""

from __future__ import annotations

import asyncio
import json
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any, Final

from contid.control.daemon.interfaces import RunControl
from contid.control.engine.messages import Begin, Goto, Hold, Message, Play, Resume, Rows
from contid.control.tick.supervisor import MOVING, Mode
from contid.errors import BadInputError
from contid.remote.protocol.wire import Code, Fields, RemoteError
from contid.remote.server.move import Credit, Move, Notify, RowMove
from contid.remote.server.pending_orders import BULK_TIMEOUT_S, PendingOrders
from contid.remote.server.preconditions import Preconditions, bad_target
from contid.remote.server.telemetry_view import TelemetryView
from contid.targets import Target
from contid.trajectory.rows import RowReader

#: Rows of a timed trajectory in all: 250 s at 200 Hz.
MAX_ROWS: Final = 50_000
#: How long robots may take to stand still before a trajectory is played, and how often that is looked at.
STANDSTILL_S: Final = 20.0
LOOK_S: Final = 0.02


class Moves:
    """The moves under way."""

    def __init__(self, orders: RunControl, view: TelemetryView, pending: PendingOrders) -> None:
        self._orders = orders
        self._view = view
        self._pending = pending
        self._preconditions = Preconditions(orders, view)
        self._numbers = 0
        self._going: dict[str, deque[Move]] = {name: deque() for name in view.configs}
        self._stream: RowMove | None = None

    # -- points ------------------------------------------------------------------------------------------

    async def point(self, client: int, target: Mapping[str, Any], notify: Notify) -> Fields:
        """Begin to go to a point; the answer comes when the control process took it."""
        line = json.dumps(target)
        try:
            parser = RowReader(line, "move", self._view.robots)
            targets = dict(parser.targets(line, 1) or {})
        except BadInputError as error:
            raise bad_target(error) from None
        if parser.timed:
            raise RemoteError(Code.BAD_TARGET, "a point has no time; stream rows with columns for that")
        self._preconditions.armed(tuple(targets))
        wrong = self._preconditions.unreachable(targets)
        if wrong:
            raise RemoteError(Code.UNREACHABLE, "; ".join(wrong.values()))
        if self._stream is not None and self._stream.client == client:
            self.abort(self._stream, "another move began")
        return await self._goto(Move(self._number(), client, notify), targets)

    async def _goto(self, move: Move, targets: Mapping[str, Target], *before: Message) -> Fields:
        for name in targets:
            move.waiting.add(name)
            self._going[name].append(move)
        future = self._pending.send([*before, *(Goto(name, target) for name, target in targets.items())])
        outcome = await self._pending.confirmed(future)
        if outcome.refused:
            for name in outcome.refused:
                move.waiting.discard(name)
                if move in self._going.get(name, ()):
                    self._going[name].remove(move)
            faults = self._view.faults(self._orders.newest(), tuple(targets))
            # A chain says the same of both its arms.
            message = "; ".join(dict.fromkeys(outcome.refused.values()))
            raise RemoteError(Code.FAULT if faults else Code.REFUSED, message, faults)
        return {"move": move.number, "tick": outcome.tick}

    # -- streams -----------------------------------------------------------------------------------------

    async def begin(self, client: int, columns: Sequence[str], notify: Notify) -> Fields:
        """Begin a stream of rows; the answer grants the first credit."""
        if any("," in name or "\n" in name or name.startswith(("{", "#")) for name in columns):
            raise RemoteError(Code.BAD_TARGET, "a column is one name, such as x_mm or left.x_mm")
        header = ",".join(columns)
        try:
            parser = RowReader(header, "rows", self._view.robots)
        except BadInputError as error:
            raise bad_target(error) from None
        self._preconditions.armed(parser.robots)
        self.abort_streams("another move began")
        credit = Credit(parser.timed, self._orders.rate_hz, asyncio.get_running_loop().time())
        move = RowMove(self._number(), client, notify, parser=parser, credit=credit, lines=[header])
        self._stream = move
        if not parser.timed:
            await self._pending.confirmed(self._pending.send([Begin(), Resume(parser.robots)]))
        return {"move": move.number, "timed": parser.timed, "credits": credit.rows}

    def rows(self, client: int, number: int, rows: Sequence[Sequence[float]]) -> Fields:
        """Take rows of the stream; what cannot be followed holds its robots and is told."""
        move = self._mine(client, number)
        move.credit.spend(len(rows), asyncio.get_running_loop().time())
        lines = [",".join(map(repr, row)) for row in rows]
        refused: list[str] = []
        if move.parser.timed:
            self._collect(move, lines)
        else:
            for line in lines:
                refused += self._follow(move, line)
        return {"credits": move.credit.rows, "refused": refused}

    def _collect(self, move: RowMove, lines: Sequence[str]) -> None:
        """Rows of a timed trajectory."""
        move.lines += lines
        move.rows += len(lines)
        if move.rows > MAX_ROWS:
            self.abort(move, "too long")
            raise RemoteError(Code.BAD_TARGET, f"more than {MAX_ROWS} rows; send the trajectory in pieces")

    def _follow(self, move: RowMove, line: str) -> list[str]:
        """A row of a live stream; what is wrong with it, in words."""
        move.rows += 1
        try:
            targets: dict[str, Target | None] = dict(move.parser.targets(line, move.rows) or {})
        except BadInputError as error:
            self._orders.send(Rows(dict.fromkeys(move.parser.robots)))
            return [str(error)]
        wrong = self._preconditions.unreachable(targets)
        targets |= dict.fromkeys(wrong)
        move.last |= {name: target for name, target in targets.items() if target is not None}
        self._orders.send(Rows(targets))
        return [f"rows:{move.rows}: {message}" for message in wrong.values()]

    async def end(self, client: int, number: int) -> Fields:
        """No further row: a live stream ends on its last one, a timed trajectory is checked and played."""
        move = self._mine(client, number)
        move.closed = True
        if move.parser.timed:
            return await self._play(move)
        self._stream = None
        if move.last:
            return await self._goto(move, move.last, Begin())
        self._orders.send(Begin())
        move.end(True, "the stream had no rows")
        return {"move": move.number}

    async def _play(self, move: RowMove) -> Fields:
        """Check a timed trajectory as a whole and have the tick follow it."""
        # Checking takes long for a large one: not in the loop that has to answer a stop.
        record = self._orders.newest()
        trajectory = await asyncio.to_thread(self._preconditions.trajectory, move.lines, record)
        robots = tuple(trajectory.targets_of_row(0))
        await self._pending.confirmed(self._pending.send([Hold()]))
        await self._standstill()
        self._still_mine(move)
        self._orders.send_bulk(Play(trajectory))
        await self._pending.confirmed(self._pending.mark_bulk(self._orders.send_bulk), BULK_TIMEOUT_S)
        self._still_mine(move)
        move.playing = True
        outcome = await self._pending.confirmed(self._pending.send([Resume(robots)]))
        duration_s = trajectory.end_s - trajectory.start_s
        return {"move": move.number, "tick": outcome.tick, "duration_s": duration_s}

    async def _standstill(self) -> None:
        """Wait until nothing moves: taking over a long trajectory may cost more than a tick."""
        for _ in range(int(STANDSTILL_S / LOOK_S)):
            record = self._orders.newest()
            if record is not None and not any(Mode(robot.mode) in MOVING for robot in record.robots):
                return
            await asyncio.sleep(LOOK_S)
        raise RemoteError(Code.REFUSED, f"the robots did not stand still within {STANDSTILL_S:g} s")

    @property
    def open(self) -> bool:
        """True while a client may send rows."""
        return self._stream is not None and not self._stream.closed

    def refill(self) -> None:
        """Grant what the time that passed allows; called often."""
        move = self._stream
        if move is None or move.closed:
            return
        if move.credit.came_back(asyncio.get_running_loop().time()):
            move.notify({"event": "credit", "move": move.number, "credits": move.credit.rows})

    # -- ends --------------------------------------------------------------------------------------------

    def abort_streams(self, message: str) -> None:
        """Whatever is streamed or played ends here; gotos notify their end themselves."""
        if self._stream is not None:
            self.abort(self._stream, message)

    def abort(self, move: RowMove, message: str) -> None:
        """A stream or a played trajectory ends before its end."""
        if self._stream is move:
            self._stream = None
        # Nothing is left to follow: a later resume arms and goes nowhere.
        self._orders.send(Begin())
        move.end(False, message)

    def streaming(self, client: int) -> bool:
        """True while a client streams, or its trajectory is played."""
        move = self._stream
        return move is not None and move.client == client and (move.playing or not move.closed)

    def notice(self, event: Mapping[str, Any]) -> None:
        """An event of the ring."""
        if event["event"] == "goto" and self._going.get(event["robot"]):
            robot = str(event["robot"])
            move = self._going[robot].popleft()
            move.waiting.discard(robot)
            if not event["arrived"]:
                move.failed.add(robot)
            if not move.waiting:
                faults = self._view.faults(self._orders.newest(), tuple(move.failed))
                message = f"{', '.join(sorted(move.failed))} did not arrive" if move.failed else ""
                move.end(not move.failed, message, faults)
        elif event["event"] == "end" and self._stream is not None and self._stream.playing:
            played, self._stream = self._stream, None
            self._orders.send(Begin())
            played.end(True, "")

    # -- inside ------------------------------------------------------------------------------------------

    def _number(self) -> int:
        self._numbers += 1
        return self._numbers

    def _mine(self, client: int, number: int) -> RowMove:
        move = self._stream
        if move is None or move.number != number or move.client != client or move.closed:
            raise RemoteError(Code.REFUSED, f"move {number} is not open; it ended or was stopped")
        return move

    def _still_mine(self, move: RowMove) -> None:
        if self._stream is not move:
            raise RemoteError(Code.STOPPED, "the robots were stopped meanwhile; nothing was played")
