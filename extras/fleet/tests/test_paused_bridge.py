"""Random orders by network, and a pause of the bridge before it takes each or while it serves it.

Everything is in one process and in virtual time: a node of the bridge with its checks, the server of the
daemon, the engine and its simulated devices. The witness is when an order that arms or moves is sent to it.
``python -m extras.fleet.tests.test_paused_bridge [--pairs N] [--seed N]`` tries more.
"""

from __future__ import annotations

import argparse
import asyncio
import logging
import random
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import pytest

from contid.control.engine.messages import (
    Estop,
    Follow,
    Goto,
    Hold,
    Message,
    Play,
    Recover,
    Resume,
    Start,
    Stop,
)
from contid.control.tick.supervisor import Mode
from contid.remote.protocol import expiry
from contid.remote.protocol.wire import PROTOCOL, decode, encode
from contid_fleet.fleet_file import MachineFile
from contid_fleet.keys import Keys, Origin
from contid_fleet.links import operator_link
from contid_fleet.links.daemon_link import DaemonLink
from contid_fleet.node import Node
from contid_fleet.rights import Right
from contid_fleet.sessions import Sessions
from tests.remote.orders.races import Client, Race, racing

STOPS = {"hold": Hold, "stop": Stop, "estop": Estop}
TARGETS = ({"f0.x_mm": 45.0, "f0.y_mm": 75.0}, {"f0.x_mm": 50.0, "f0.y_mm": 75.0})
MOVES = (Resume, Follow, Recover, Goto, Play, Start)
#: How long after it was given an order may still arm or move [s].
WITHIN_S = 1.0
#: Most turns of the loop that an order is served for before the bridge pauses.
TURNS = 40
OPERATOR = Origin("anna", "1")


@dataclass
class Asked:
    """A question from the network, and its response."""

    key: str
    payload: bytes
    response: asyncio.Future[dict[str, Any]] = field(default_factory=asyncio.Future)

    def answer(self, key: str, payload: bytes) -> None:
        """See `contid_fleet.net.Question.answer`."""
        self.response.set_result(decode(payload))


class Wired:
    """The writer of a connection that ends in the server of a race."""

    def __init__(self, race: Race, link: DaemonLink) -> None:
        self._race, self._link, self._client = race, link, Client(1)
        self._tasks: set[asyncio.Task[None]] = set()

    def write(self, line: bytes) -> None:
        """Serve a request; its response comes some turns later."""
        fields = decode(line.strip())
        task = asyncio.ensure_future(self._serve(fields.pop("id"), fields.pop("verb"), fields))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _serve(self, number: int, verb: str, fields: dict[str, Any]) -> None:
        response: dict[str, Any] = {"ok": True, "result": {"client": 1, "protocol": PROTOCOL}}
        if verb == "status":
            expiry.check_expiry(verb, fields)
            response["result"] = {"lease": {"client": 1}}
        elif verb != "hello":
            result = await self._race.give(self._client, verb, **fields)
            response = {"ok": True, "result": result} if result is not None else {"ok": False, "error": {}}
        self._link._take(encode({"id": number, **response})[:-1])


class PausedBridge:
    """Pairs of an order and a pause.

    Attributes:
        wrong: what came too late, or not at all.
        found: orders that were carried out or refused, by verb and end.
    """

    def __init__(self, race: Race, rng: random.Random, patch: pytest.MonkeyPatch) -> None:
        self.wrong: list[str] = []
        self.found: Counter[str] = Counter()
        self.now_s = 1000.0
        self._race, self._rng, self._keys = race, rng, Keys("lab")
        self._sent: list[tuple[float, Message]] = []
        sent = race.model.sent

        def keep(message: Message) -> None:
            self._sent.append((self.now_s, message))
            sent(message)

        race.model.sent = keep  # type: ignore[method-assign]
        patch.setattr(expiry, "clock_s", lambda: self.now_s)

        class Link(DaemonLink):
            async def connect(self) -> None:
                self._writer, self.open = cast(Any, Wired(race, self)), True
                self.hello = {"protocol": PROTOCOL}

        patch.setattr(operator_link, "DaemonLink", Link)
        sessions = Sessions()
        sessions.change(OPERATOR, True)
        machine = MachineFile(
            fleet="lab",
            listen=["tcp/127.0.0.1:7447"],
            operators={"anna": [Right.MOVE, Right.ARM]},
            trust_local_users=True,
        )
        self._node = Node("hand", Path("none"), machine, cast(Any, None), self._keys, sessions)

    async def passes(self, seconds: float) -> None:
        """Time in which the bridge runs."""
        for _ in range(round(seconds / 0.1)):
            self.now_s += 0.1
            self._node.look()

    async def until(self, mode: Mode) -> None:
        """Wait for the state of the first robot."""
        for _ in range(3000):
            newest = self._race.run.newest()
            if newest is not None and newest.robots[0].mode == mode:
                return
            await asyncio.sleep(0)
        raise AssertionError(f"it is not in {mode.name}")

    def ask(self, verb: str, **fields: Any) -> asyncio.Future[dict[str, Any]]:
        """An order that the network brings to the bridge."""
        key = self._keys.do("hand", OPERATOR.operator, OPERATOR.session, verb)
        asked = Asked(key, encode(fields)[:-1])
        self._node._asked(cast(Any, asked), asyncio.get_running_loop())
        return asked.response

    async def pair(self) -> None:
        """One order and one pause."""
        rng = self._rng
        verb = rng.choice(["resume", "recover", "move", "move", "hold", "stop", "estop"])
        where = rng.choice(["before", "within", "within"])
        pause_s = rng.choice([0.0, rng.uniform(0.0, 1.0), rng.uniform(1.0, 60.0)])
        await self.passes(3.0)
        assert (await self.ask("resume", after_stop=True))["ok"]
        await self.until(Mode.HOLD)
        if verb in ("resume", "recover"):
            await self.ask("estop")
            await self.until(Mode.OFF)
        fields: dict[str, Any] = {"target": rng.choice(TARGETS)} if verb == "move" else {}
        del self._sent[:]
        given_s = self.now_s
        self.now_s += pause_s * (where == "before")
        serving = self.ask(verb, **fields)
        if where == "within":
            for _ in range(rng.randrange(TURNS)):
                await asyncio.sleep(0)
            self.now_s += pause_s
        response = await serving
        for _ in range(25):
            await asyncio.sleep(0)
        self.found[f"{verb} {'ok' if response.get('ok') else 'refused'}"] += 1
        what = f"{verb}, {pause_s:.1f} s, {where}"
        if verb in STOPS and not any(isinstance(message, STOPS[verb]) for _, message in self._sent):
            self.wrong.append(f"{what}: not carried out")
        self.wrong += [
            f"{what}: {type(message).__name__} {at_s - given_s:.1f} s after it was given"
            for at_s, message in self._sent
            if at_s - given_s > WITHIN_S + 1e-6 and isinstance(message, MOVES)
        ]


async def paused(pairs: int, seed: int) -> PausedBridge:
    """Try pairs, and return what was found."""
    with pytest.MonkeyPatch.context() as patch:
        async with racing(pace=1) as race:
            tried = PausedBridge(race, random.Random(seed), patch)
            await tried.until(Mode.HOLD)
            for _ in range(pairs):
                await tried.pair()
    assert race.model.broken == []
    return tried


async def test_no_order_by_network_arms_or_moves_later_than_a_second_after_it_was_given() -> None:
    tried = await paused(80, 1)
    assert tried.wrong == []
    assert all(tried.found[f"{verb} ok"] for verb in ("resume", "move", *STOPS)), tried.found


@pytest.mark.campaign
async def test_no_order_of_many_by_network_arms_or_moves_later_than_a_second_after_it_was_given() -> None:
    assert (await paused(1000, 2)).wrong == []


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=2)
    options = parser.parse_args()
    logging.disable(logging.CRITICAL)
    done = asyncio.run(paused(options.pairs, options.seed))
    print(*done.wrong, f"{len(done.wrong)} of {options.pairs} pairs were wrong; {dict(done.found)}", sep="\n")
