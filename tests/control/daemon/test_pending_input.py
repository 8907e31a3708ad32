"""Orders that reach a run before it begins: stops are kept, and what cannot be carried out is refused."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import pytest

from contid.control.daemon.inputs import CancellableReader, InputCancelledError
from contid.control.daemon.pending_input import PendingInput
from contid.control.engine.events import RunEvent
from contid.control.engine.events.robots import MarkReached, OrderRefused
from contid.control.engine.messages import (
    ClearFault,
    Estop,
    Follow,
    Goto,
    Grip,
    Hold,
    Mark,
    Message,
    Recover,
    Resume,
    Rows,
    Start,
    Stop,
)
from contid.errors import ContidError
from contid.targets import Target


async def answers(order: Message) -> tuple[list[RunEvent], bool]:
    pending = PendingInput("waiting for a trajectory on stdin", lambda reader: None)
    found = pending.answer(order)
    await pending.result()
    return found, pending.stopped


@pytest.mark.parametrize(
    "order",
    [
        Resume(),
        Follow(),
        Recover(),
        Grip(0.5),
        Goto("f0", Target(actuation=(0.06, 0.06))),
        Rows({}),
        Start(1.0),
    ],
    ids=repr,
)
async def test_what_needs_devices_is_refused(order: Message) -> None:
    found, stopped = await answers(order)
    assert found == [OrderRefused(message="waiting for a trajectory on stdin; nothing is connected yet")]
    assert not stopped


@pytest.mark.parametrize("order", [Hold(), Stop(), Estop()], ids=repr)
async def test_a_stop_is_kept(order: Message) -> None:
    assert await answers(order) == ([], True)


@pytest.mark.parametrize("wrong", [False, True])
async def test_an_input_that_is_cancelled_when_it_has_just_been_read_is_ignored(
    monkeypatch: pytest.MonkeyPatch, wrong: bool
) -> None:
    """A client takes over while the thread that read it is joined."""

    def read(reader: CancellableReader) -> None:
        if wrong:
            raise ContidError("line 3 is wrong")

    async def joined(join: Callable[[float], None], timeout_s: float) -> None:
        pending.cancel()
        join(timeout_s)

    pending = PendingInput("waiting for a trajectory on stdin", read)
    monkeypatch.setattr(asyncio, "to_thread", joined)
    with pytest.raises(InputCancelledError):
        await pending.result()


async def test_there_is_no_fault_to_clear_and_a_mark_is_reached() -> None:
    assert await answers(ClearFault()) == ([], False)
    assert await answers(Mark(7)) == ([MarkReached(number=7, tick=0)], False)
