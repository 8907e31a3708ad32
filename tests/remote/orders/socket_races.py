"""Raced orders of clients on a real socket, judged by a model of the docs (`tests.remote.orders.history`).

Server and engine are real, in this process and in virtual time; requests are pipelined, clients leave in the
middle of them and come back. ``python -m tests.remote.orders.socket_races [--orders N] [--seed N]``.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import logging
import random
import tempfile
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from contid.control.engine.events import RunEvent
from contid.control.tick.supervisor import Mode
from contid.remote.protocol.socket_path import Endpoint
from contid.remote.server.server import SocketServer
from tests.remote.orders.history import History, Order
from tests.remote.orders.races import StopModel, VirtualRun

#: Orders of one race, and orders of a client under way.
PER_RACE = 1000
PIPELINED = (1, 1, 1, 3)
#: Lines that stop all robots and are refused.
MALFORMED = (
    b'{"verb":"estop","speed":1}\n', b'\xef\xbb\xbf{"verb":"estop"}\n', b'{"verb": "estop"\n',
    b'{"id":{},"verb":"estop"}\n', b'{"verb":"estop","robots":["thumb"]}\n',
)  # fmt: skip


class SocketRun(VirtualRun):
    """A run in virtual time behind a socket."""

    def __init__(self, robots: int) -> None:
        self.model = StopModel()  # of the states after an estop that has arrived
        super().__init__(self.model, robots)
        self.listener: Callable[[RunEvent], None] = lambda event: None

    def listen(self, listener: Callable[[RunEvent], None]) -> None:
        self.listener = listener


class SocketRace:
    """Clients of one daemon; ``steps`` numbers what they see."""

    def __init__(self, path: Path, rng: random.Random) -> None:
        self.rng, self.path, self.steps, self.clients = rng, path, 0, 0
        self.run = SocketRun(rng.choice([1, 1, 1, 2]))
        self.pace = rng.choice([1, 1, 1, 2, 4])
        self.orders: list[Order] = []
        self.closed: dict[int, int] = {}
        self.under_way = 0

    def step(self) -> int:
        """The number of an event."""
        self.steps += 1
        return self.steps

    @property
    def tick(self) -> int:
        """The tick that comes next."""
        return self.run.last + 1

    async def ticks(self) -> None:
        """Ticks in each turn of the loop in which a client waits, and a few more."""
        spare = 400  # until the robots hold
        while True:
            spare = 40 if self.under_way else spare - 1
            for _ in range(self.pace if spare > 0 else 0):
                self.run.turn(self.run.listener)
            await asyncio.sleep(0 if spare > 0 else 1e-3)

    async def go(self, orders: int, clients: int) -> list[str]:
        """Let clients give orders until there were enough; what was wrong."""
        server = asyncio.create_task(SocketServer(Endpoint(self.path)).serve(self.run))
        ticks = asyncio.create_task(self.ticks())
        try:
            while not self.run.records or {*self.modes(self.run.last).values()} != {"HOLD"}:
                await asyncio.sleep(0)
            await asyncio.gather(*(self._client(orders) for _ in range(clients)))
        finally:
            for task in (server, ticks):
                task.cancel()
            await asyncio.wait([server, ticks])
        modes = {tick: self.modes(tick) for tick in self.run.records}
        return [*self.run.model.broken, *History(self.orders, modes, self.closed).wrong()]

    def modes(self, tick: int) -> dict[str, str]:
        """State by robot in a tick."""
        robots = zip(self.run.loaded.driven, self.run.records[tick].robots, strict=True)
        return {name: Mode(record.mode).name for name, record in robots}

    async def _client(self, orders: int) -> None:
        """A person or program that comes back after it left."""
        while len(self.orders) < orders:
            self.clients += 1
            wire = Wire(self, self.clients)
            await wire.connect()
            try:
                await self._talk(wire, orders)
            finally:
                await wire.close()

    async def _talk(self, wire: Wire, orders: int) -> None:
        tasks: set[asyncio.Task[None]] = set()
        pipelined = self.rng.choice(PIPELINED)
        while len(self.orders) < orders and (len(self.orders) < 8 or self.rng.random() > 0.01):
            if len(tasks) < pipelined:
                task = asyncio.create_task(self._order(wire))
                tasks.add(task)
                task.add_done_callback(tasks.discard)
            for _ in range(self.rng.choice([1, 3, 10, 60, 200])):
                await asyncio.sleep(0)
        if self.rng.random() < 0.5 or len(self.orders) >= orders:
            await asyncio.gather(*tasks)
        else:
            if self.rng.random() < 0.5:
                wire.give("estop")
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _order(self, wire: Wire) -> None:
        """Random orders, one after the other."""
        rng = self.rng
        target = {"f0.x_mm": rng.choice([45.0, 50.0]), "f0.y_mm": 75.0}
        columns = [*target]
        match rng.choice(["stop", "resume", "resume", "move", "stream", "play", "play", "lease", "person"]):
            case "stop":
                how = rng.choice(["hold", "hold", "hold", "stop", "estop", "estop", "malformed"])
                await (wire.give("estop", rng.choice(MALFORMED)) if how == "malformed" else wire.give(how))
            case "resume":
                after: dict[str, Any] = {"after_stop": True} if rng.random() < 0.4 else {}
                await wire.give(rng.choice(["resume", "resume", "recover"]), **after)
            case "move":
                await wire.give("move", target=target)
            case "stream":
                begun = await wire.give("move", columns=columns)
                for _ in range(3 if begun.ok else 0):
                    await wire.give("rows", move=begun.result["move"], rows=[[50.0, 75.0]])
                if begun.ok:
                    await wire.give("end", move=begun.result["move"])
            case "play":
                begun = await wire.give("move", columns=["t_s", *columns])
                if begun.ok:
                    move = begun.result["move"]
                    rows = [[0.05 * step, 50.0, 75.0] for step in range(3)]
                    await wire.give("rows", move=move, rows=rows)
                    await wire.give("end", move=move, hold_at_start=rng.random() < 0.5)
                    await wire.give("start", move=move)
            case "lease":
                fields: dict[str, Any] = {"timeout_s": 60.0, "takeover": rng.random() < 0.5}
                await wire.give("acquire", **fields, unless_stopped=rng.random() < 0.3)
                for _ in range(rng.choice([0, 30, 300])):
                    await asyncio.sleep(0)
            case "person":
                await wire.give("acquire", timeout_s=60.0, takeover=True)
                await wire.give("resume")
                await wire.give("move", target=target)
        if wire.moves and rng.random() < 0.7:
            wire.moves = False
            await wire.give("release")


class Wire:
    """The connection of one client."""

    def __init__(self, race: SocketRace, number: int) -> None:
        self.race, self.number, self.moves = race, number, False
        self._waiting: dict[int, tuple[Order, asyncio.Future[Order]]] = {}
        #: Estops whose refusal has no id.
        self._nameless: list[tuple[Order, asyncio.Future[Order]]] = []

    async def connect(self) -> None:
        """Connect, and read answers from then on."""
        self._reader, self._writer = await asyncio.open_unix_connection(str(self.race.path))
        self._task = asyncio.create_task(self._read())

    def give(self, verb: str, line: bytes = b"", **fields: Any) -> asyncio.Future[Order]:
        """Send an order, or a line that is one; the future is done with its answer."""
        race = self.race
        future: asyncio.Future[Order] = asyncio.get_running_loop().create_future()
        order = Order(self.number, verb, fields, race.step(), race.tick)
        race.orders.append(order)
        race.under_way += 1
        if line:
            self._nameless.append((order, future))
        else:
            self._waiting[order.sent] = (order, future)
            line = json.dumps({"id": order.sent, "verb": verb, **fields}).encode() + b"\n"
        with suppress(ConnectionError):
            self._writer.write(line)
        return future

    async def _read(self) -> None:
        with suppress(ConnectionError):
            while line := await self._reader.readline():
                answer = json.loads(line)
                if "ok" not in answer:
                    continue
                number = answer["id"]
                order, future = self._nameless.pop(0) if number is None else self._waiting.pop(number)
                race = self.race
                race.under_way -= 1
                order.answered, order.answered_tick, order.ok = race.step(), race.run.last, answer["ok"]
                self.moves |= bool(order.ok) and order.verb in ("acquire", "move")
                order.code = answer.get("error", {}).get("code", "")
                order.result = answer.get("result", {})
                if not future.done():
                    future.set_result(order)

    async def close(self) -> None:
        """Leave, whatever is under way."""
        self._task.cancel()
        await asyncio.wait([self._task])
        self._writer.close()
        with suppress(ConnectionError):
            await self._writer.wait_closed()
        self.race.closed[self.number] = self.race.step()
        for order, future in (*self._waiting.values(), *self._nameless):
            order.answered_tick = self.race.run.last
            self.race.under_way -= 1
            future.cancel()


async def socket_race(orders: int, clients: int, seed: int) -> tuple[list[str], Counter[str]]:
    """One race; what was wrong, and its orders by verb and answer."""
    with tempfile.TemporaryDirectory(prefix="contid-") as folder:
        race = SocketRace(Path(folder) / "s", random.Random(seed))
        wrong = await race.go(orders, clients)
    answers = Counter(f"{order.verb}:{order.code or order.ok}" for order in race.orders)
    return wrong, answers


def socket_races(orders: int, seed: int) -> list[str]:
    """Races of 8 clients; prints their figures and returns what was wrong."""
    wrong: list[str] = []
    answers: Counter[str] = Counter()
    while answers.total() < orders:
        found, given = asyncio.run(socket_race(PER_RACE, 8, seed))
        wrong += [f"seed {seed}: {each}" for each in found]
        answers += given
        print(f"seed {seed}: {answers.total()} orders, {len(wrong)} wrong", *found, sep="\n", flush=True)
        seed += 1
    print(dict(sorted(answers.items())))
    return wrong


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--orders", type=int, default=PER_RACE)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    logging.disable(logging.CRITICAL)
    socket_races(asked.orders, asked.seed)
