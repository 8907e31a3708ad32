"""What the holder of the motion right moves: points, and trajectories row by row under credit.

A point becomes a goto of every robot it names. A live stream (no column ``t_s``) makes its newest row the
target; its credit is a bucket of `LIVE_ROWS` that refills at the rate of the tick, so that a client cannot
send faster than rows can be followed. A timed trajectory is collected, checked as a whole like a file, and
then played by the tick itself.
"""

from __future__ import annotations

import asyncio
import io
import json
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from contid.control.messages import Begin, Goto, Hold, Message, Play, Resume, Rows
from contid.control.preflight import Preflight, Unreachable
from contid.control.record import TickRecord
from contid.control.roles import Orders
from contid.control.supervisor import MOVING, Mode
from contid.control.wiring import chain_guards
from contid.errors import BadInputError
from contid.remote.ledger import BULK_S, Ledger
from contid.remote.picture import Picture
from contid.remote.protocol import Code, Fields, RemoteError
from contid.targets import Target
from contid.trajectory.read import read_trajectory
from contid.trajectory.stream import StreamParser
from contid.trajectory.timed import Trajectory

#: Rows of a live stream that may be under way: a burst of so many ticks.
LIVE_ROWS: Final = 8
#: Rows of a timed trajectory that may be under way, and in all: 50 000 are 250 s at 200 Hz.
TIMED_ROWS: Final = 1024
MAX_ROWS: Final = 50_000
#: How long robots may take to stand still before a trajectory is played.
STANDSTILL_S: Final = 20.0

_ARMED: Final = frozenset({Mode.APPROACH, Mode.RUN, Mode.HOLD})

#: Tells the owner of a move about it.
Tell = Callable[[Mapping[str, Any]], None]


@dataclass(slots=True)
class Move:
    """One move of a client.

    Attributes:
        number: its name on the socket.
        client: whose it is.
        tell: reaches its owner.
        waiting: robots whose goto has not ended.
        failed: robots whose goto was dropped.
        parser: of the rows, None for a point.
        lines: rows of a timed trajectory, as text.
        rows: how many came.
        last: newest good target of every robot of a live stream.
        credits: rows the client may still send.
        granted_s: when the bucket was last filled.
        playing: a timed trajectory is being followed.
        closed: no further row may come.
    """

    number: int
    client: int
    tell: Tell
    waiting: set[str] = field(default_factory=set)
    failed: set[str] = field(default_factory=set)
    parser: StreamParser | None = None
    lines: list[str] = field(default_factory=list)
    rows: int = 0
    last: dict[str, Target] = field(default_factory=dict)
    credits: float = 0.0
    granted_s: float = 0.0
    playing: bool = False
    closed: bool = False

    @property
    def streaming(self) -> bool:
        """True while it is more than gotos that end by themselves."""
        return self.parser is not None and (self.playing or not self.closed)


class Moves:
    """The moves under way."""

    def __init__(self, orders: Orders, picture: Picture, ledger: Ledger) -> None:
        self._orders = orders
        self._picture = picture
        self._ledger = ledger
        self._guards = chain_guards(orders.loaded)
        self._numbers = 0
        self._going: dict[str, deque[Move]] = {name: deque() for name in picture.plans}
        self._stream: Move | None = None

    # -- points ------------------------------------------------------------------------------------------

    async def point(self, client: int, target: Mapping[str, Any], tell: Tell) -> Fields:
        """Begin to go to a point; the answer comes when the control process took it."""
        line = json.dumps(target)
        try:
            parser = StreamParser(line, "move", self._picture.robots)
            targets = dict(parser.parse(line, 1) or {})
        except BadInputError as error:
            raise _bad(error) from None
        if parser.timed:
            raise RemoteError(Code.BAD_TARGET, "a point has no time; stream rows with columns for that")
        record = self._armed(tuple(targets))
        self._reachable(targets, record)
        if self._stream is not None and self._stream.client == client:
            self.abort(self._stream, "another move began")
        return await self._goto(self._new(client, tell), targets)

    async def _goto(self, move: Move, targets: Mapping[str, Target], *before: Message) -> Fields:
        for name in targets:
            move.waiting.add(name)
            self._going[name].append(move)
        future = self._ledger.order([*before, *(Goto(name, target) for name, target in targets.items())])
        outcome = await self._ledger.confirmed(future)
        if outcome.refused:
            for name in outcome.refused:
                move.waiting.discard(name)
                if move in self._going.get(name, ()):
                    self._going[name].remove(move)
            faults = self._picture.faults(self._orders.newest(), tuple(targets))
            words = "; ".join(
                dict.fromkeys(outcome.refused.values())
            )  # a chain says the same of both its arms
            raise RemoteError(Code.FAULT if faults else Code.REFUSED, words, faults)
        return {"move": move.number, "tick": outcome.tick}

    # -- streams -----------------------------------------------------------------------------------------

    async def begin(self, client: int, columns: Sequence[str], tell: Tell) -> Fields:
        """Begin a stream of rows; the answer grants the first credit."""
        if any("," in name or "\n" in name or name.startswith(("{", "#")) for name in columns):
            raise RemoteError(Code.BAD_TARGET, "a column is one name, such as x_mm or left.x_mm")
        try:
            parser = StreamParser(",".join(columns), "rows", self._picture.robots)
        except BadInputError as error:
            raise _bad(error) from None
        self._armed(parser.robots)
        self.abort_streams("another move began")
        move = self._stream = self._new(client, tell)
        move.parser = parser
        move.credits = TIMED_ROWS if parser.timed else LIVE_ROWS
        move.granted_s = asyncio.get_running_loop().time()
        if parser.timed:
            move.lines.append(",".join(columns))
        else:
            await self._ledger.confirmed(self._ledger.order([Begin(), Resume(parser.robots)]))
        return {"move": move.number, "timed": parser.timed, "credits": int(move.credits)}

    def rows(self, client: int, number: int, rows: Sequence[Sequence[float]]) -> Fields:
        """Take rows of the stream; what cannot be followed holds its robots and is told."""
        move = self._mine(client, number)
        assert move.parser is not None
        self._refill(move)
        if len(rows) > int(move.credits):
            words = f"{len(rows)} rows sent, {int(move.credits)} allowed; wait for credit"
            raise RemoteError(Code.NO_CREDIT, words)
        move.credits -= len(rows)
        refused: list[str] = []
        for row in rows:
            move.rows += 1
            line = ",".join(map(repr, row))
            if move.parser.timed:
                move.lines.append(line)
                continue
            try:
                targets: dict[str, Target | None] = dict(move.parser.parse(line, move.rows) or {})
            except BadInputError as error:
                refused.append(str(error))
                self._orders.send(Rows(dict.fromkeys(move.parser.robots)))
                continue
            for name, words in self._wrong(targets, self._orders.newest()).items():
                refused.append(f"rows:{move.rows}: {words}")
                targets[name] = None
            move.last |= {name: target for name, target in targets.items() if target is not None}
            self._orders.send(Rows(targets))
        if move.rows > MAX_ROWS and move.parser.timed:
            self.abort(move, "too long")
            raise RemoteError(Code.BAD_TARGET, f"more than {MAX_ROWS} rows; send the trajectory in pieces")
        if move.parser.timed:
            move.credits = TIMED_ROWS
        return {"credits": int(move.credits), "refused": refused}

    async def end(self, client: int, number: int) -> Fields:
        """No further row: a live stream ends on its last one, a timed trajectory is checked and played."""
        move = self._mine(client, number)
        assert move.parser is not None
        move.closed = True
        if not move.parser.timed:
            self._stream = None
            if not move.last:
                self._orders.send(Begin())
                self._done(move, True, "the stream had no rows")
                return {"move": move.number}
            return await self._goto(move, move.last, Begin())
        # Checking takes long for a large one: not in the loop that has to answer a stop.
        trajectory = await asyncio.to_thread(self._read, move.lines, self._orders.newest())
        robots = tuple(trajectory.targets_of_row(0))
        await self._ledger.confirmed(self._ledger.order([Hold()]))
        await self._standstill()
        self._still_mine(move)
        self._orders.send_bulk(Play(trajectory))
        await self._ledger.confirmed(self._ledger.mark_bulk(self._orders.send_bulk), BULK_S)
        self._still_mine(move)
        move.playing = True
        outcome = await self._ledger.confirmed(self._ledger.order([Resume(robots)]))
        return {
            "move": move.number,
            "tick": outcome.tick,
            "duration_s": trajectory.end_s - trajectory.start_s,
        }

    def _read(self, lines: Sequence[str], record: TickRecord | None) -> Trajectory:
        try:
            trajectory = read_trajectory(io.StringIO("\n".join(lines)), "rows", self._picture.robots)
            if self._orders.unreachable is Unreachable.REFUSE or self._guards:
                self._preflight(record).trajectory(trajectory, "rows")
        except BadInputError as error:
            raise _bad(error) from None
        return trajectory

    async def _standstill(self) -> None:
        """Wait until nothing moves: taking over a long trajectory may cost more than a tick."""
        for _ in range(int(STANDSTILL_S / 0.02)):
            record = self._orders.newest()
            if record is not None and not any(Mode(robot.mode) in MOVING for robot in record.robots):
                return
            await asyncio.sleep(0.02)
        raise RemoteError(Code.REFUSED, f"the robots did not stand still within {STANDSTILL_S:g} s")

    @property
    def open(self) -> bool:
        """True while a client may send rows."""
        return self._stream is not None and not self._stream.closed

    def refill(self) -> None:
        """Grant what the time that passed allows; called often."""
        move = self._stream
        if move is not None and not move.closed and move.credits < LIVE_ROWS / 2:
            self._refill(move)
            if move.credits >= LIVE_ROWS / 2:
                move.tell({"event": "credit", "move": move.number, "credits": int(move.credits)})

    def _refill(self, move: Move) -> None:
        assert move.parser is not None
        now_s = asyncio.get_running_loop().time()
        if not move.parser.timed:
            grown = move.credits + (now_s - move.granted_s) * self._orders.rate_hz
            move.credits = min(grown, LIVE_ROWS)
        move.granted_s = now_s

    # -- ends --------------------------------------------------------------------------------------------

    def abort_streams(self, words: str) -> None:
        """Whatever is streamed or played ends here; gotos tell their end themselves."""
        if self._stream is not None:
            self.abort(self._stream, words)

    def abort(self, move: Move, words: str) -> None:
        """A stream or a played trajectory ends before its end."""
        if self._stream is move:
            self._stream = None
        # Nothing is left to follow: a later resume arms and goes nowhere.
        self._orders.send(Begin())
        self._done(move, False, words)

    def streaming(self, client: int) -> bool:
        """True while a client streams, or its trajectory is played."""
        return self._stream is not None and self._stream.client == client and self._stream.streaming

    def notice(self, event: Mapping[str, Any]) -> None:
        """An event of the ring."""
        if event["event"] == "goto" and self._going.get(event["robot"]):
            robot = str(event["robot"])
            move = self._going[robot].popleft()
            move.waiting.discard(robot)
            if not event["arrived"]:
                move.failed.add(robot)
            if not move.waiting:
                faults = self._picture.faults(self._orders.newest(), tuple(move.failed))
                words = f"{', '.join(sorted(move.failed))} did not arrive" if move.failed else ""
                self._done(move, not move.failed, words, faults)
        elif event["event"] == "end" and self._stream is not None and self._stream.playing:
            move, self._stream = self._stream, None
            self._orders.send(Begin())
            self._done(move, True, "")

    @staticmethod
    def _done(move: Move, reached: bool, words: str, faults: Mapping[str, Fields] | None = None) -> None:
        move.closed, move.playing = True, False
        told: Fields = {"event": "move", "move": move.number, "reached": reached, "words": words}
        move.tell({**told, "faults": dict(faults)} if faults else told)

    # -- inside ------------------------------------------------------------------------------------------

    def _new(self, client: int, tell: Tell) -> Move:
        self._numbers += 1
        return Move(self._numbers, client, tell)

    def _mine(self, client: int, number: int) -> Move:
        move = self._stream
        if move is None or move.number != number or move.client != client or move.closed:
            raise RemoteError(Code.REFUSED, f"move {number} is not open; it ended or was stopped")
        return move

    def _still_mine(self, move: Move) -> None:
        if self._stream is not move:
            raise RemoteError(Code.STOPPED, "the robots were stopped meanwhile; nothing was played")

    def _armed(self, robots: Sequence[str]) -> TickRecord | None:
        record = self._orders.newest()
        faults = self._picture.faults(record, robots)
        if faults:
            what = "; ".join(
                f"{name}: fault {told['number']} {told['name']}" for name, told in faults.items()
            )
            raise RemoteError(Code.FAULT, f"{what}; clear-fault, then resume", faults)
        for name in robots:
            mode = self._picture.mode(name, record)
            if mode not in _ARMED:
                raise RemoteError(Code.NOT_ARMED, f"{name} is {mode.name}, not armed; resume first")
        return record

    def _preflight(self, record: TickRecord | None) -> Preflight:
        commands = {name: self._picture.command(name, record) for name in self._picture.plans}
        seeds = {name: command for name, command in commands.items() if command is not None}
        plans, unreachable = tuple(self._picture.plans.values()), self._orders.unreachable
        return Preflight(plans, self._guards, unreachable, seeds)

    def _wrong(self, targets: Mapping[str, Target | None], record: TickRecord | None) -> dict[str, str]:
        if self._orders.unreachable is Unreachable.NEAREST and not self._guards:
            return {}
        return self._preflight(record).row(targets)

    def _reachable(self, targets: Mapping[str, Target], record: TickRecord | None) -> None:
        wrong = self._wrong(targets, record)
        if wrong:
            raise RemoteError(Code.UNREACHABLE, "; ".join(wrong.values()))


def _bad(error: BadInputError) -> RemoteError:
    found = [str(finding) for finding in error.findings[:20]]
    return RemoteError(Code.BAD_TARGET, "\n".join(found))
