"""Threads that ask models for an event loop: calls in their order, and none that nothing waits for."""

from __future__ import annotations

import asyncio
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from contid.control.process.isolation.model_threads import (
    FairLock,
    GivenUpError,
    ModelThreads,
    check_awaited,
)
from tests.support.fingers import load


@pytest.fixture
def threads() -> ModelThreads:
    found = ModelThreads(load(2))
    found._threads["f1"] = ThreadPoolExecutor(1)
    return found


async def test_only_what_asks_an_isolated_model_leaves_the_event_loop(threads: ModelThreads) -> None:
    with threads._threads["f1"]:
        here = threading.get_ident()
        assert await threads.call(("f0",), threading.get_ident) == here
        assert await threads.call(("f0", "f1"), threading.get_ident) != here


async def test_calls_for_one_model_take_place_in_their_order(threads: ModelThreads) -> None:
    order: list[int] = []
    with threads._threads["f1"]:
        await asyncio.gather(*(threads.call(("f1",), order.append, number) for number in range(20)))
    assert order == list(range(20))


async def test_a_call_that_is_given_up_ends_with_its_next_question(threads: ModelThreads) -> None:
    asked, ended, gate = threading.Event(), threading.Event(), threading.Event()

    def ask() -> None:
        try:
            while gate.wait(20.0):
                asked.set()
                check_awaited()
        except GivenUpError:
            ended.set()
            raise

    with threads._threads["f1"]:
        gate.set()
        task = asyncio.create_task(threads.call(("f1",), ask))
        while not asked.is_set():
            await asyncio.sleep(0.001)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        assert ended.wait(20.0)
        assert await threads.call(("f1",), lambda: "the next one") == "the next one"
    check_awaited()


def test_a_thread_that_asks_on_and_on_keeps_no_other_waiting() -> None:
    """With an ordinary lock the other one waits for a chance between two questions."""
    lock, over, asked = FairLock(), threading.Event(), [0]

    def ask() -> None:
        while not over.is_set():
            with lock:
                asked[0] += 1
                time.sleep(0.002)

    other = threading.Thread(target=ask)
    other.start()
    try:
        while not asked[0]:
            time.sleep(0.001)
        for _ in range(20):
            before = asked[0]
            with lock:
                assert asked[0] <= before + 2
            time.sleep(0.001)
    finally:
        over.set()
        other.join()
