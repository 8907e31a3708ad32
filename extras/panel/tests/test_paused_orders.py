"""Random orders, and a pause of the panel, of its connection or of the daemon before or while each is served.

Everything is in one process and in virtual time: the checks of the panel, the server, the engine and its
simulated devices. The witness is when an order that arms or moves is sent to the engine.
``python -m extras.panel.tests.test_paused_orders [--pairs N] [--seed N]`` tries more.
"""

from __future__ import annotations

import argparse
import asyncio
import logging
import random
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

import contid_panel.expiry
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
from contid.remote.protocol.wire import RemoteError
from contid_panel.expiry import VALID_S, validity
from tests.remote.orders.races import Client, Race, racing

STOPS = {"hold": Hold, "stop": Stop, "estop": Estop}
TARGETS = ({"f0.x_mm": 45.0, "f0.y_mm": 75.0}, {"f0.x_mm": 50.0, "f0.y_mm": 75.0})
MOVES = (Resume, Follow, Recover, Goto, Play, Start)
#: Most turns of the loop that an order is served for before the daemon pauses.
TURNS = 40


class Clock:
    """The clock of the machine, which goes on in a pause only."""

    now_s = 1000.0

    def __call__(self) -> float:
        return self.now_s


@contextmanager
def clocked() -> Iterator[Clock]:
    clock = Clock()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(expiry, "clock_s", clock)
        patch.setattr(contid_panel.expiry, "clock_s", clock)
        yield clock


class Paused:
    """Pairs of an order and a pause.

    Attributes:
        wrong: what came too late, or not at all.
        found: orders that were carried out or refused, by verb and end.
    """

    def __init__(self, race: Race, clock: Clock, rng: random.Random) -> None:
        self.wrong: list[str] = []
        self.found: Counter[str] = Counter()
        self._race, self._clock, self._rng = race, clock, rng
        self._client = Client(1)
        self._sent: list[tuple[float, Message]] = []
        sent = race.model.sent

        def keep(message: Message) -> None:
            self._sent.append((clock.now_s, message))
            sent(message)

        race.model.sent = keep  # type: ignore[method-assign]

    async def until(self, mode: Mode) -> None:
        """Wait for the state of the first robot."""
        for _ in range(3000):
            newest = self._race.run.newest()
            if newest is not None and newest.robots[0].mode == mode:
                return
            await asyncio.sleep(0)
        raise AssertionError(f"it is not in {mode.name}")

    async def pair(self) -> None:
        """One order and one pause."""
        rng, race, clock, client = self._rng, self._race, self._clock, self._client
        verb = rng.choice(["resume", "recover", "move", "move", "hold", "stop", "estop", "play"])
        where = rng.choice(["panel", "connection", "daemon", "daemon"])
        pause_s = rng.choice([0.0, rng.uniform(0.0, 1.0), rng.uniform(1.0, 60.0)])
        await race.give(client, "resume", after_stop=True)
        await self.until(Mode.HOLD)
        if verb in ("resume", "recover"):
            await race.give(client, "estop")
            await self.until(Mode.OFF)
        fields: dict[str, Any] = {"target": rng.choice(TARGETS)} if verb == "move" else {}
        asked = verb
        if verb == "play":
            columns = ["t_s", "f0.x_mm", "f0.y_mm"]
            begun = await race.give(client, "move", columns=columns)
            assert begun is not None
            rows = [[0.05 * step, 50.0, 75.0] for step in range(3)]
            await race.give(client, "rows", move=begun["move"], rows=rows)
            asked, fields = "end", {"move": begun["move"]}
        del self._sent[:]
        pressed_s = clock.now_s
        clock.now_s += pause_s * (where == "panel")
        try:
            until_s = validity(verb, pressed_s * 1e3)
        except RemoteError as error:
            self.found[f"{verb} {error.code}"] += 1
            assert verb not in STOPS
            return
        clock.now_s += pause_s * (where == "connection")
        if until_s is not None and asked not in expiry.LASTING:
            fields[expiry.FIELD] = until_s
        serving = asyncio.ensure_future(race.give(client, asked, **fields))
        if where == "daemon":
            for _ in range(rng.randrange(TURNS)):
                await asyncio.sleep(0)
            clock.now_s += pause_s
        result = await serving
        for _ in range(25):  # what it left in the daemon, a trajectory on its way
            await asyncio.sleep(0)
        self.found[f"{verb} {'refused' if result is None else 'ok'}"] += 1
        what = f"{verb}, {pause_s:.1f} s in the {where}"
        if verb in STOPS and not any(isinstance(message, STOPS[verb]) for _, message in self._sent):
            self.wrong.append(f"{what}: not carried out")
        late = [
            f"{type(message).__name__} {at_s - pressed_s:.1f} s after the press"
            for at_s, message in self._sent
            if at_s - pressed_s > VALID_S + 1e-6 and isinstance(message, MOVES)
        ]
        if late:
            self.wrong.append(f"{what}: {', '.join(late)}")


async def paused(pairs: int, seed: int) -> Paused:
    """Try pairs, and return what was found."""
    with clocked() as clock:
        async with racing(pace=1) as race:
            tried = Paused(race, clock, random.Random(seed))
            await tried.until(Mode.HOLD)
            for _ in range(pairs):
                await tried.pair()
    assert race.model.broken == []
    return tried


async def test_no_order_arms_or_moves_later_than_a_second_after_its_press() -> None:
    tried = await paused(120, 1)
    assert tried.wrong == []
    assert all(tried.found[f"{verb} ok"] for verb in ("resume", "move", *STOPS)), tried.found


@pytest.mark.campaign
async def test_no_order_of_many_arms_or_moves_later_than_a_second_after_its_press() -> None:
    assert (await paused(1000, 2)).wrong == []


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=2)
    asked = parser.parse_args()
    logging.disable(logging.CRITICAL)
    tried = asyncio.run(paused(asked.pairs, asked.seed))
    print(
        *tried.wrong, f"{len(tried.wrong)} of {asked.pairs} pairs were wrong; {dict(tried.found)}", sep="\n"
    )
