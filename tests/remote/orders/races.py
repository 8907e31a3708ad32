"""Raced orders of several clients in one process, against a small model of docs/remote.md, "The lease".

The server is real, and so are the engine and its simulated devices, in virtual time. The witness is what is
sent to the engine, and for which request. ``python -m tests.remote.orders.races [--orders N]
[--seed N]`` runs more of them.
"""

from __future__ import annotations

import argparse
import asyncio
import contextvars
import logging
import random
from collections import Counter
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from typing import Any

from contid.control.engine.events import RunEvent
from contid.control.engine.events.run import NoteWritten
from contid.control.engine.messages import (
    Estop,
    Follow,
    Goto,
    Hold,
    Message,
    Play,
    Recover,
    Resume,
    Rows,
    Start,
    Stop,
)
from contid.control.engine.tick_layout import TickRecord
from contid.control.engine.virtual import VirtualProcess
from contid.control.engine.wiring import record_layout
from contid.control.tick.preflight.rows import Unreachable
from contid.control.tick.supervisor import Mode
from contid.remote.protocol.peer_credentials import ClientRole
from contid.remote.protocol.wire import RemoteError, encode
from contid.remote.server.query_handler import Subscription
from contid.remote.server.request_handler import RequestHandler
from tests.support.fingers import load

STOPS = ("hold", "stop", "estop", "malformed")
MOVING = frozenset({Mode.APPROACH, Mode.RUN, Mode.HOLD, Mode.ARMING})
#: Orders of one race.
PER_RACE = 1000
#: Client and fields of the request under way, and whose stop it ended by moving.
REQUEST: contextvars.ContextVar[tuple[int, Mapping[str, Any], set[int]]] = contextvars.ContextVar("request")


class Client:
    """A caller without a connection."""

    def __init__(self, number: int) -> None:
        self.number, self.name, self.by, self.role = number, f"client {number}", "", ClientRole.ALL
        self.subscription: Subscription | None = None
        self.move = 0
        self.tasks: set[asyncio.Task[None]] = set()

    def notify(self, fields: Mapping[str, Any]) -> None:
        """Notices are not read."""


class StopModel:
    """The rule of the docs: who moves while a stop of another client stands breaks it.

    A stop stands until a client acquires, or resumes with ``after_stop``, or until its own client goes on:
    with a resume, or with a move that is not refused.
    """

    def __init__(self) -> None:
        self.standing: set[int] = set()
        #: By request under way: whose stop it ended by moving, which stands again if it is refused.
        self.ended: list[set[int]] = []
        self.moved: Counter[str] = Counter()
        self.broken: list[str] = []
        self.estops = 0

    def sent(self, message: Message) -> None:
        """The server sends an order."""
        client, fields, ended = REQUEST.get((0, {}, set()))
        verb = fields.get("verb", "")
        self.estops += isinstance(message, Estop)
        if verb in STOPS and isinstance(message, Hold | Stop | Estop):
            self.standing.add(client)
        if isinstance(message, Resume | Follow | Recover | Goto | Play | Start) or (
            isinstance(message, Rows) and any(target is not None for target in message.targets.values())
        ):
            if fields.get("after_stop"):
                self.lift()
            if others := self.standing - {client}:
                self.broken.append(f"client {client} {verb}: {type(message).__name__} after {others}")
            self.moved[verb] += 1
            ended |= self.standing & {client}
            self.standing.discard(client)

    def lift(self) -> None:
        """No stop stands, nor will one that a move ended which is refused only now."""
        for stops in (self.standing, *self.ended):
            stops.clear()


class VirtualRun:
    """A run in virtual time as the server sees it."""

    rate_hz = 200.0
    unreachable = Unreachable.REFUSE
    input_active = False
    waiting = ""

    def __init__(self, model: StopModel, robots: int = 2) -> None:
        self.loaded = load(robots)
        self._layout = record_layout(self.loaded, self.rate_hz)
        self._inbox: list[Message] = []
        #: Until which tick a long trajectory, and what was sent after it, crosses the pipe.
        self._crosses_to = 0
        self._events: list[RunEvent] = []
        self._newest: TickRecord | None = None
        self.records: dict[int, TickRecord] = {}
        self.last = -1
        self._model = model
        self._process = VirtualProcess(self.loaded, self.rate_hz, self, attended=True)
        self._process.engine.arm()

    def write(self, values: list[float]) -> None:
        self._newest = self._layout.decode(tuple(values))
        self.last = self._newest.tick
        self.records[self.last] = self._newest

    def event(self, event: RunEvent) -> None:
        self._events.append(event)

    def turn(self, notice: Callable[[RunEvent], None]) -> None:
        """One tick, after the orders that were sent."""
        self._process.begin()
        inbox: list[Message] = []
        if not self.crossing:
            inbox, self._inbox = self._inbox, []
        for message in inbox:
            self._process.engine.obey(message, self._process.tick)
            states = self._process.engine.robots.states
            if isinstance(message, Estop) and any(state.mode in MOVING for state in states):
                self._model.broken.append(f"an estop left {[state.mode.name for state in states]}")
        self._process.turn()
        events, self._events = self._events, []
        for event in events:
            notice(event)

    def send(self, message: Message) -> None:
        self._model.sent(message)
        self._inbox.append(message)
        if isinstance(message, Play):
            self._crosses_to = self._process.tick + 20

    @property
    def crossing(self) -> bool:
        """A trajectory is on its way."""
        return self._process.tick < self._crosses_to

    def newest(self) -> TickRecord | None:
        return self._newest

    def record_of(self, tick: int) -> TickRecord | None:
        return self.records.get(tick)

    def detach_input(self) -> None:
        raise AssertionError("there is no input")

    def note(self, event: NoteWritten) -> None:
        raise AssertionError("no client writes a note")

    def lateness(self, ticks: int) -> list[float]:
        return []

    def costs(self) -> list[float]:
        return [0.0] * len(self.loaded.driven)

    def refresh(self) -> None:
        """Events come with the ticks."""

    def listen(self, listener: Callable[[RunEvent], None]) -> None:
        """Events go to `turn`."""

    def interrupt(self) -> None:
        raise AssertionError("no client ends the run")


class Race:
    """Clients that give orders without waiting for each other."""

    def __init__(self, pace: int = 3) -> None:
        self.pace = pace
        self.model = StopModel()
        self.run = VirtualRun(self.model)
        self.handler = RequestHandler(self.run, lambda client, fields: None, lambda: 0)
        self.orders = 0
        self.refused: Counter[str] = Counter()
        self.foreign: list[str] = []

    async def give(self, client: Client, verb: str, **fields: Any) -> dict[str, Any] | None:
        """One request as a connection serves it; None when it was refused."""
        request = {"verb": verb, **fields}
        ended: set[int] = set()
        REQUEST.set((client.number, request, ended))
        self.model.ended.append(ended)
        self.orders += 1
        try:
            if verb in ("estop", "malformed"):
                before = self.model.estops
                wrong = {} if verb == "estop" else {"speed": 1}
                request = {"verb": "estop", **wrong}
                self.handler.stops.estop_before_turn(client, encode(request))
                if self.model.estops == before:
                    self.model.broken.append(f"client {client.number}: its estop was not sent")
                await asyncio.sleep(0)
            result = await self.handler.serve(client, request)
        except RemoteError as error:
            self.refused[error.code] += 1
            if verb == "move":  # its stop stands
                self.model.standing |= ended
            return None
        finally:
            self.model.ended = [each for each in self.model.ended if each is not ended]
        if "tick" in result and "robots" in result and verb != "start":
            robots = zip(self.run.loaded.driven, self.run.records[result["tick"]].robots, strict=True)
            modes = {name: Mode(record.mode).name for name, record in robots}
            if result["robots"] != modes:
                self.foreign.append(f"{verb}: {result}, the record has {modes}")
        if verb == "acquire" and not fields.get("unless_stopped"):
            self.model.lift()
        if "t_s" in fields.get("columns", ()):  # begun in one step; its rows move nothing yet
            self.model.standing.discard(client.number)
        return result

    async def order(self, client: Client, rng: random.Random) -> None:
        """A random order."""
        target = {"f0.x_mm": rng.choice([45.0, 50.0]), "f0.y_mm": 75.0}
        columns = ["f0.x_mm", "f0.y_mm"]
        kinds = ("stop", "resume", "resume", "move", "move", "stream", "stream", "play", "play", "lease")
        match rng.choice(kinds):
            case "stop":
                await self.give(client, rng.choice(("hold", "hold", "hold", "hold", "hold", *STOPS)))
            case "resume":
                after = {"after_stop": True} if rng.random() < 0.5 else {}
                await self.give(client, rng.choice(["resume", "resume", "resume", "recover"]), **after)
            case "move":
                await self.give(client, "move", target=target)
            case "stream" if begun := await self.give(client, "move", columns=columns):
                for _ in range(3):
                    await self.give(client, "rows", move=begun["move"], rows=[[50.0, 75.0]])
                await self.give(client, "end", move=begun["move"])
            case "play" if begun := await self.give(client, "move", columns=["t_s", *columns]):
                rows = [[0.05 * step, 50.0, 75.0] for step in range(3)]
                await self.give(client, "rows", move=begun["move"], rows=rows)
                await self.give(client, "end", move=begun["move"], hold_at_start=rng.random() < 0.5)
                await self.give(client, "start", move=begun["move"])
            case "lease":
                how = {"takeover": rng.random() < 0.5, "unless_stopped": rng.random() < 0.3}
                await self.give(client, rng.choice(["acquire", "release"]), **how)

    async def ticks(self) -> None:
        """Ticks, for ever; one or a few in each turn of the loop, as in a daemon that is busy."""
        while True:
            for _ in range(self.pace):
                self.run.turn(self.handler.notice)
            await asyncio.sleep(0)

    async def go(self, orders: int, clients: int, rng: random.Random) -> None:
        """Begin orders of random clients, of which each waits for three at most, until there were enough."""
        crowd = [Client(number) for number in range(1, clients + 1)]
        while self.orders < orders:
            client = rng.choice(crowd)
            if len(client.tasks) < 3:
                task = asyncio.create_task(self.order(client, rng))
                client.tasks.add(task)
                task.add_done_callback(client.tasks.discard)
            for _ in range(rng.choice([0, 0, 1, 3, 10, 50])):
                await asyncio.sleep(0)
            if rng.random() < 0.02:
                await asyncio.sleep(0.02)
        await asyncio.gather(*(task for client in crowd for task in client.tasks))


@asynccontextmanager
async def racing(pace: int = 3) -> AsyncIterator[Race]:
    """A race that ticks."""
    found = Race(pace)
    ticks = asyncio.create_task(found.ticks())
    try:
        yield found
    finally:
        ticks.cancel()
        await asyncio.wait([ticks])
        found.handler.pending.close()


async def races(orders: int, seed: int) -> list[str]:
    """Races of 2 to 8 clients with one to three ticks a turn; prints them and returns what was wrong."""
    wrong: list[str] = []
    given, estops, moved = 0, 0, Counter[str]()
    while given < orders:
        rng = random.Random(seed)
        async with racing(rng.choice([1, 1, 1, 2, 3])) as race:
            await race.go(PER_RACE, rng.choice([2, 5, 8, 8, 8]), rng)
        wrong += [f"seed {seed}: {each}" for each in race.model.broken + race.foreign]
        given, estops, seed = given + race.orders, estops + race.model.estops, seed + 1
        moved += race.model.moved
        print(
            f"seed {seed - 1}: {given} orders, {estops} estops, {moved.total()} moves, {len(wrong)} wrong",
            flush=True,
        )
    return wrong


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--orders", type=int, default=PER_RACE)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    logging.disable(logging.CRITICAL)
    print(*asyncio.run(races(asked.orders, asked.seed)), sep="\n")
