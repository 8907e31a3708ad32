"""A model of others that answers slowly holds neither orders nor stops of the others, and undoes no stop.

What was true before its check need not be true after it: each test changes something meanwhile. The server
and the engine are real (`tests.remote.orders.races`); the model of f1 answers when the test lets it.
"""

from __future__ import annotations

import asyncio
import random
import time
from collections.abc import AsyncIterator, Callable
from typing import Any, NamedTuple

import pytest

from contid.control.engine.messages import Stop
from contid.control.process.isolation.model_threads import ModelThreads
from contid.control.tick.supervisor import Mode
from contid.remote.protocol.expiry import FIELD, clock_s
from tests.remote.orders.gated_model import GatedModel, SentMoves, isolated
from tests.remote.orders.races import Client, Race, racing

SLOW = {"f1.x_mm": 45.0, "f1.y_mm": 75.0}
QUICK = {"f0.x_mm": 45.0, "f0.y_mm": 75.0}
COLUMNS = ["f1.x_mm", "f1.y_mm"]
#: Longest time of what does not wait for the model, on a busy machine; far below the wait for a gate.
AT_ONCE_S = 3.0
#: What a race must have given often enough for a stop to meet it.
MOVERS = ("move", "resume", "rows", "end")


class SlowRace(NamedTuple):
    """Two robots that hold, of which f1 has a slow model."""

    race: Race
    model: GatedModel
    sent: SentMoves

    async def until(self, condition: Callable[[], object]) -> None:
        async with asyncio.timeout(20.0):
            while not condition():
                await asyncio.sleep(0.001)

    async def under_check(self, client: Client, verb: str, **fields: Any) -> asyncio.Task[Any]:
        """An order whose check waits for the model."""
        self.model.gate.clear()
        asked = self.model.asked
        task = asyncio.create_task(self.race.give(client, verb, **fields))
        await self.until(lambda: self.model.asked > asked)
        return task

    async def refused(self, task: asyncio.Task[Any], code: str) -> None:
        """The order is refused at once, although its check goes on, and nothing is sent for it later."""
        async with asyncio.timeout(AT_ONCE_S):
            assert await task is None
        assert self.race.refused == {code: 1}
        self.model.gate.set()
        await asyncio.sleep(0.05)
        assert self.sent.robots == []
        assert self.race.model.broken == []

    def modes(self) -> set[Mode]:
        newest = self.race.run.newest()
        return set() if newest is None else {Mode(robot.mode) for robot in newest.robots}


@pytest.fixture
async def slow() -> AsyncIterator[SlowRace]:
    async with racing() as race:
        with isolated(race.handler, "f1") as model:
            found = SlowRace(race, model, SentMoves(race))
            await found.until(lambda: found.modes() == {Mode.HOLD})
            yield found
        assert model.on_loop == 0


async def test_another_client_is_served_and_stops_during_a_check(slow: SlowRace) -> None:
    person, program = Client(1), Client(2)
    task = await slow.under_check(program, "move", target=SLOW)
    began_s = time.monotonic()
    assert await slow.race.give(person, "ping") is not None
    assert await slow.race.give(person, "status") is not None
    assert await slow.race.give(person, "hold", robots=["f0"]) is not None
    assert time.monotonic() - began_s < AT_ONCE_S
    await slow.refused(task, "stopped")
    assert "client 1" in slow.race.handler.lease.stopped_by


@pytest.mark.parametrize("verb", ["hold", "stop", "estop", "malformed"])
async def test_a_stop_of_its_own_client_overtakes_a_check(slow: SlowRace, verb: str) -> None:
    program = Client(1)
    task = await slow.under_check(program, "move", target=SLOW)
    await slow.race.give(program, verb)
    slow.race.refused.pop("bad-request", None)
    await slow.refused(task, "stopped")


async def test_a_stop_between_the_answer_and_its_order_comes_first(
    slow: SlowRace, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The check has its answer, and its order is about to go on in the same turn of the event loop."""
    call = ModelThreads.call

    async def then_stop(*arguments: Any) -> Any:
        found = await call(*arguments)
        asyncio.get_running_loop().call_soon(slow.race.handler.stops.estop_all, Client(1))
        return found

    monkeypatch.setattr(ModelThreads, "call", then_stop)
    task = await slow.under_check(Client(2), "move", target=SLOW)
    slow.model.gate.set()
    await slow.refused(task, "stopped")


async def test_what_another_client_took_over_is_not_moved(slow: SlowRace) -> None:
    task = await slow.under_check(Client(1), "move", target=SLOW)
    assert await slow.race.give(Client(2), "acquire", takeover=True) is not None
    await slow.refused(task, "stopped")
    assert slow.race.handler.lease.held_by(2)


async def test_what_lost_its_lease_is_not_moved(slow: SlowRace) -> None:
    task = await slow.under_check(Client(1), "move", target=SLOW)
    slow.race.handler.disconnected(1)
    await slow.refused(task, "stopped")


async def test_a_request_whose_connection_ends_moves_nothing(slow: SlowRace) -> None:
    task = await slow.under_check(Client(1), "move", target=SLOW)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    asked = slow.model.asked
    slow.model.gate.set()
    await asyncio.sleep(0.05)
    assert slow.sent.robots == []
    assert slow.model.asked == asked, "the thread goes on"


async def test_a_robot_that_left_its_mode_is_not_moved(slow: SlowRace) -> None:
    """As by a fault of its devices: no client has ordered it."""
    task = await slow.under_check(Client(1), "move", target=SLOW)
    slow.race.run._inbox.append(Stop(("f1",)))
    await slow.until(lambda: Mode.OFF in slow.modes())
    slow.model.gate.set()
    await slow.refused(task, "not-armed")


async def test_a_move_that_stood_still_with_the_daemon_is_late(
    slow: SlowRace, monkeypatch: pytest.MonkeyPatch
) -> None:
    task = await slow.under_check(Client(1), "move", target=SLOW, **{FIELD: clock_s() + 30.0})
    later_s = clock_s() + 60.0
    monkeypatch.setattr("contid.remote.protocol.expiry.clock_s", lambda: later_s)
    slow.model.gate.set()
    await slow.refused(task, "expired")


async def test_an_order_that_waited_for_a_check_is_late(slow: SlowRace) -> None:
    """It arms robots after its press: a resume behind a move of the same client."""
    program = Client(1)
    task = await slow.under_check(program, "move", target=SLOW)
    resume = asyncio.create_task(slow.race.give(program, "resume", **{FIELD: clock_s() + 0.1}))
    await asyncio.sleep(0.3)
    slow.model.gate.set()
    assert await resume is None
    assert slow.race.refused == {"expired": 1}
    assert await task is not None


async def test_orders_of_one_client_stay_in_order(slow: SlowRace) -> None:
    program = Client(1)
    task = await slow.under_check(program, "move", target=SLOW)
    behind = [
        asyncio.create_task(slow.race.give(program, verb, **fields))
        for verb, fields in (
            ("move", {"target": QUICK}), ("move", {"target": SLOW}), ("release", {}),
            ("move", {"target": QUICK}),
        )
    ]  # fmt: skip
    await asyncio.sleep(0.05)
    assert slow.sent.robots == []
    slow.model.gate.set()
    assert None not in await asyncio.gather(task, *behind)
    assert slow.sent.robots == ["f1", "f0", "f1", "f0"]


@pytest.mark.parametrize(
    ("verb", "fields"),
    [
        ("move", {"target": QUICK}), ("resume", {"after_stop": True}), ("acquire", {}),
        ("move", {"columns": ["f0.x_mm", "f0.y_mm"]}),
    ],
)  # fmt: skip
@pytest.mark.parametrize("stopper", [1, 2], ids=["its own stop", "the stop of another"])
async def test_what_waited_behind_a_check_does_not_follow_a_stop(
    slow: SlowRace, verb: str, fields: dict[str, Any], stopper: int
) -> None:
    """It was given before the stop, so it would have been stopped; after it, it would undo the stop."""
    program = Client(1)
    task = await slow.under_check(program, "move", target=SLOW)
    behind = asyncio.create_task(slow.race.give(program, verb, **fields))
    await asyncio.sleep(0.01)
    await slow.race.give(Client(stopper), "hold")
    assert (await task, await behind) == (None, None)
    assert slow.race.refused == {"stopped": 2}
    slow.model.gate.set()
    await asyncio.sleep(0.05)
    assert slow.sent.robots == []
    assert slow.race.handler.lease.stopped_by == f"client 'client {stopper}' (hold)"
    assert await slow.race.give(program, "resume", after_stop=True) is not None, "its next order has its turn"


async def test_a_refused_check_leaves_its_turn_to_the_next_order(slow: SlowRace) -> None:
    program = Client(1)
    task = await slow.under_check(program, "move", target={"f1.x_mm": 500.0, "f1.y_mm": 75.0})
    behind = asyncio.create_task(slow.race.give(program, "move", target=QUICK))
    slow.model.gate.set()
    assert await task is None
    assert await behind is not None
    assert slow.race.refused == {"unreachable": 1}
    assert slow.race.handler.lease.held_by(1), "the refused move does not take the lease from the next one"


async def test_no_row_follows_a_stop(slow: SlowRace) -> None:
    program = Client(2)
    begun = await slow.race.give(program, "move", columns=COLUMNS)
    assert begun is not None
    rows = [[50.0, 75.0], [50.1, 75.0], [50.2, 75.0]]
    task = await slow.under_check(program, "rows", move=begun["move"], rows=rows)
    await slow.race.give(Client(1), "hold")
    await slow.refused(task, "stopped")


async def test_rows_and_the_end_of_their_stream_stay_in_order(slow: SlowRace) -> None:
    program = Client(1)
    begun = await slow.race.give(program, "move", columns=COLUMNS)
    assert begun is not None
    task = await slow.under_check(program, "rows", move=begun["move"], rows=[[50.0, 75.0], [50.1, 75.0]])
    end = asyncio.create_task(slow.race.give(program, "end", move=begun["move"]))
    await asyncio.sleep(0.05)
    slow.model.gate.set()
    assert await task is not None
    assert await end is not None
    assert slow.sent.robots == ["f1", "f1", "f1"]


async def test_a_stop_ends_the_check_of_a_trajectory(slow: SlowRace) -> None:
    program = Client(2)
    begun = await slow.race.give(program, "move", columns=["t_s", *COLUMNS])
    assert begun is not None
    rows = [[0.05 * step, 50.0, 75.0] for step in range(20)]
    assert await slow.race.give(program, "rows", move=begun["move"], rows=rows) is not None
    task = await slow.under_check(program, "end", move=begun["move"])
    assert await slow.race.give(Client(1), "hold") is not None
    asked = slow.model.asked
    await slow.refused(task, "stopped")
    assert slow.model.asked == asked, "its thread asks on"


async def test_what_is_shown_has_no_tip_until_the_model_answers(slow: SlowRace) -> None:
    slow.model.gate.clear()
    began_s = time.monotonic()
    status = await slow.race.give(Client(1), "status")
    assert time.monotonic() - began_s < AT_ONCE_S
    assert status is not None
    assert status["robots"]["f1"]["tip_mm"] is None
    assert status["robots"]["f0"]["tip_mm"] is not None
    slow.model.gate.set()
    async with asyncio.timeout(20.0):
        while status["robots"]["f1"]["tip_mm"] is None:
            status = await slow.race.give(Client(1), "status")
            assert status is not None


async def test_no_client_of_a_race_moves_after_the_stop_of_another() -> None:
    """The race of `test_raced_orders`, with checks that take a moment in a thread."""
    async with racing(pace=1) as race:
        rng = random.Random(7)
        with isolated(race.handler, "f0") as model:
            opened = asyncio.create_task(_flicker(model, rng))
            for orders in range(400, 2001, 400):  # on a busy machine few of the first ones move anything
                await race.go(orders, 6, rng)
                if min(race.model.moved[verb] for verb in MOVERS) > 2:
                    break
            opened.cancel()
    assert race.model.broken == []
    assert race.foreign == []
    assert model.on_loop == 0
    assert min(race.model.moved[verb] for verb in MOVERS) > 2, race.model.moved


async def _flicker(model: GatedModel, rng: random.Random) -> None:
    while True:
        model.gate.clear()
        await asyncio.sleep(rng.choice([0.0, 0.002, 0.01]))
        model.gate.set()
        await asyncio.sleep(0.001)
