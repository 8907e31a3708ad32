"""No client moves after the stop of another, in raced orders (`tests.remote.orders.races`)."""

from __future__ import annotations

import asyncio
import random
from collections.abc import AsyncIterator

import pytest

from contid.control.engine.messages import Estop, Follow, Hold, Message, Stop
from contid.control.tick.supervisor import Mode
from tests.remote.orders.races import STOPS, Client, Race, races, racing


@pytest.fixture
async def race() -> AsyncIterator[Race]:
    async with racing() as found:
        yield found


async def test_no_client_moves_after_the_stop_of_another() -> None:
    async with racing(pace=1) as race:
        await race.go(700, 8, random.Random(2))
    assert race.model.broken == []
    assert race.foreign == []
    assert min(race.model.moved[verb] for verb in ("move", "resume", "rows", "end")) > 2, race.model.moved
    assert race.refused["stopped"] > 50, race.refused
    assert race.model.estops > 10


@pytest.mark.campaign
async def test_no_client_of_many_races_moves_after_the_stop_of_another() -> None:
    assert await races(20_000, 1) == []


@pytest.mark.parametrize("script", STOPS)
async def test_the_stop_of_a_script_does_not_undo_that_of_a_person(race: Race, script: str) -> None:
    person, program = Client(1), Client(2)
    while race.run.newest() is None or not await race.give(
        program, "move", target={"f0.x_mm": 50.0, "f0.y_mm": 75.0}
    ):
        await asyncio.sleep(0)
    await race.give(person, "estop")
    assert await race.give(program, "resume") is None
    await race.give(program, script)
    assert await race.give(program, "resume") is None
    assert await race.give(program, "move", target={"f0.x_mm": 45.0, "f0.y_mm": 75.0}) is None
    assert await race.give(program, "acquire", unless_stopped=True) is None
    assert race.refused["stopped"] >= 4
    assert "client 1" in race.handler.lease.stopped_by
    assert await race.give(program, "resume", after_stop=True) is not None
    assert race.model.broken == []


async def test_a_trajectory_that_arrives_after_a_stop_is_not_followed(race: Race) -> None:
    """It crosses the pipe in parts; a stop overtakes it."""
    person, program = Client(1), Client(2)
    columns = ["t_s", "f0.x_mm", "f0.y_mm"]
    while (begun := await race.give(program, "move", columns=columns)) is None:
        await asyncio.sleep(0)
    rows = [[0.05 * step, 50.0, 75.0] for step in range(3)]
    await race.give(program, "rows", move=begun["move"], rows=rows)
    end = asyncio.create_task(race.give(program, "end", move=begun["move"]))
    while not race.run.crossing:
        await asyncio.sleep(0)
    await race.give(person, "hold")
    assert await end is None
    await race.give(person, "resume")
    for _ in range(20):
        await asyncio.sleep(0)
    record = race.run.newest()
    assert record is not None
    assert record.robots[0].mode == Mode.HOLD


async def test_an_order_to_go_on_that_is_refused_leaves_the_stop_standing(race: Race) -> None:
    """A robot on its way to rest refuses; no other client may go on without looking."""
    person, program, other = Client(1), Client(2), Client(3)
    target = {"f0.x_mm": 45.0, "f0.y_mm": 75.0}
    while race.run.newest() is None or not await race.give(program, "move", target=target):
        await asyncio.sleep(0)
    stopping = asyncio.create_task(race.give(person, "stop"))
    await asyncio.sleep(0)
    assert await race.give(program, "resume", after_stop=True) is None
    assert await stopping is not None
    assert race.refused["refused"] == 1, race.refused
    while race.run.newest().robots[0].mode != Mode.OFF:  # type: ignore[union-attr]
        await asyncio.sleep(0)
    assert await race.give(other, "resume") is None
    assert race.refused["stopped"] == 1


async def test_a_stop_that_was_lifted_does_not_stand_again_for_a_refused_move(race: Race) -> None:
    """A client moves during its own stop, and another one acquires before that move is refused."""
    program, person, other = Client(2), Client(5), Client(4)
    while race.run.newest() is None or not await race.give(program, "move", target=POINT):
        await asyncio.sleep(0)
    for _ in range(40):
        await asyncio.sleep(0)
    stopping = asyncio.create_task(race.give(program, "stop"))
    moving = asyncio.create_task(race.give(program, "move", target={**POINT, "f0.x_mm": 50.0}))
    acquiring = asyncio.create_task(race.give(person, "acquire", takeover=True))
    assert [await moving, await acquiring is None, await stopping is None] == [None, False, False]
    assert race.refused["refused"] == 1, race.refused
    assert await race.give(person, "release") is not None
    await race.give(other, "resume")  # which robots on their way to rest may refuse
    assert race.model.moved["resume"] == 1, race.refused
    assert race.model.broken == []


POINT = {"f0.x_mm": 45.0, "f0.y_mm": 75.0}
TIMED_ROWS = [[0.05 * step, 50.0, 75.0] for step in range(3)]


async def ready(race: Race, program: Client) -> int:
    """Arm, and send the rows of a trajectory; returns the number of its move."""
    while race.run.newest() is None or not await race.give(program, "move", target=POINT):
        await asyncio.sleep(0)
    begun = await race.give(program, "move", columns=["t_s", *POINT])
    assert begun is not None
    await race.give(program, "rows", move=begun["move"], rows=TIMED_ROWS)
    return int(begun["move"])


@pytest.mark.parametrize("stop", [Stop, Estop])
@pytest.mark.parametrize("order", ["stream", "play", "start"])
async def test_a_move_whose_robot_refuses_to_follow_ends_and_arms_nothing(
    race: Race, monkeypatch: pytest.MonkeyPatch, order: str, stop: type[Stop | Estop]
) -> None:
    """A stop is carried out before the order to follow, and no record has shown it yet."""
    program = Client(1)
    move, send = await ready(race, program), race.run.send
    if order == "start":
        assert await race.give(program, "end", move=move, hold_at_start=True) is not None

    def stop_first(message: Message) -> None:
        if isinstance(message, Follow):
            send(stop(("f0",)))
        send(message)

    monkeypatch.setattr(race.run, "send", stop_first)
    began = {
        "stream": lambda: race.give(program, "move", columns=[*POINT]),
        "play": lambda: race.give(program, "end", move=move),
        "start": lambda: race.give(program, "start", move=move),
    }[order]
    assert await began() is None
    assert race.refused["refused"] == 1, race.refused
    assert not race.handler.moves.along_rows(1) or order == "start"
    seen = []
    for _ in range(60):
        await asyncio.sleep(0)
        seen.append(race.run.newest().robots[0].mode)  # type: ignore[union-attr]
    assert {*seen} <= {Mode.STOPPING, Mode.OFF}
    assert seen[-1] == Mode.OFF


async def test_a_trajectory_that_was_stopped_during_its_check_sends_no_hold(
    race: Race, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another client may move by then."""
    person, program = Client(1), Client(2)
    move, send = await ready(race, program), race.run.send
    sent: list[Message] = []

    def record(message: Message) -> None:
        sent.append(message)
        send(message)

    monkeypatch.setattr(race.run, "send", record)
    end = asyncio.create_task(race.give(program, "end", move=move))
    await asyncio.sleep(0)
    assert await race.give(person, "stop", robots=["f1"]) is not None
    assert await end is None
    assert race.refused["stopped"] == 1, race.refused
    assert any(isinstance(each, Stop) for each in sent)
    assert not any(isinstance(each, Hold) for each in sent)


async def test_a_lease_that_is_released_during_the_check_ends_the_trajectory(race: Race) -> None:
    program = Client(1)
    move = await ready(race, program)
    end = asyncio.create_task(race.give(program, "end", move=move))
    await asyncio.sleep(0)
    assert await race.give(program, "release") is not None
    assert await end is None
    assert race.refused["stopped"] == 1, race.refused
    assert not race.model.moved["end"]
