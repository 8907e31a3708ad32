"""A model of one robot that takes too long costs that robot only, and a replay asks it as little."""

from __future__ import annotations

import math
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import pytest

from contid.control.engine.messages import Estop, Hold, Message, Stop
from contid.control.engine.tick_costs import UnansweredError
from contid.control.process.tick_alarm import ProcessorWait, TickAlarm
from contid.control.tick.supervisor import Mode
from tests.support.broken.broken_run import (
    BROKEN_FROM,
    TICKS,
    BrokenRun,
    StreamedRun,
    good_of,
    ordered,
    unharmed,
)  # fmt: skip


@pytest.fixture(scope="module")
def sound() -> list[str]:
    return good_of(BrokenRun())


@pytest.fixture(scope="module")
def sound_stream() -> list[str]:
    return good_of(StreamedRun())


def sleep(*_: object) -> Any:
    time.sleep(60.0)
    return None


def compute(*_: object) -> Any:
    end_s = time.monotonic() + 60.0
    while time.monotonic() < end_s:
        with suppress(Exception):  # an interrupt is none of the model's errors
            math.sqrt(2.0)
    return None


def compute_in_c(*_: object) -> Any:
    return sum(range(6_000_000))  # one call, in which no alarm is delivered


@contextmanager
def alarmed(run: BrokenRun) -> Iterator[None]:
    """The alarm of a control process, on the clock of the machine."""
    costs = run.process.engine.costs
    costs.now = time.monotonic
    before = signal.getsignal(signal.SIGALRM)
    TickAlarm(costs, ProcessorWait(), 200.0).install()
    try:
        yield
    finally:
        signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize("slow", [pytest.param(sleep, marks=pytest.mark.campaign), compute, compute_in_c])
def test_a_tick_that_takes_too_long_costs_its_robot_only(sound: list[str], slow: Callable[..., Any]) -> None:
    run = BrokenRun()
    run.break_model(inverse=slow, forward=slow)
    began_s = time.monotonic()
    with alarmed(run):
        records = run.go()
    assert time.monotonic() - began_s < 30.0
    assert unharmed(records, sound)
    assert run.fault() == ("MODEL_TOO_SLOW", "its model was interrupted after 100 ms")
    assert {record.robots[1].mode for record in records[BROKEN_FROM + 1 :]} == {Mode.FAULT}
    # A replay is given the event of the interrupt, and asks the model as little.
    (event,) = [event for event in run.collector.events if event["event"] == "overran"]
    again = BrokenRun()
    again.break_model()
    engine = again.process.engine
    engine.arm()
    while again.process.tick < TICKS:
        again.process.begin()
        if again.process.tick == event["tick"]:
            engine.robots.overran["f1", event["question"]] = UnansweredError(event["message"])
        again.process.turn()
    again.process.close()
    assert repr(again.collector.records) == repr(records)


def test_a_model_that_is_slow_at_a_row_costs_its_robot_only(sound_stream: list[str]) -> None:
    run = StreamedRun()
    run.break_model(inverse=sleep)
    began_s = time.monotonic()
    with alarmed(run):
        records = run.go()
    assert time.monotonic() - began_s < 30.0
    assert unharmed(records, sound_stream)
    assert run.fault() == ("MODEL_TOO_SLOW", "its model was interrupted after 100 ms")


@pytest.mark.parametrize("order", [Hold(), Stop(), Estop()])
def test_a_model_that_is_slow_at_an_order_costs_its_robot_only(order: Message) -> None:
    run = BrokenRun()
    run.break_model(inverse=sleep, forward=sleep)
    began_s = time.monotonic()
    with alarmed(run):
        states = ordered(run, order)
    assert time.monotonic() - began_s < 30.0
    assert states[0].mode is (Mode.HOLD if order == Hold() else Mode.OFF)
    assert states[1].mode is (Mode.OFF if order == Estop() else Mode.FAULT)
    assert states[1].enabled is (order == Hold())
