"""A defect of one robot's model or driver costs that robot only, reported by its own message, whatever it is.

The witness of the other robot is its records: the same to the bit as in a run without the defect.
"""

from __future__ import annotations

import math
import signal
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest

from contid.control.engine.cycle import VirtualClock
from contid.control.engine.messages import Begin, Estop, Grip, Hold, Message, Rows, Stop
from contid.control.engine.ports import BusTrackers
from contid.control.engine.virtual import VirtualProcess
from contid.control.engine.wiring import open_buses
from contid.control.process.tick_alarm import ProcessorWait, TickAlarm
from contid.control.tick.state import RobotState
from contid.control.tick.supervisor import Mode
from contid.errors import ContidError
from contid.hal import Sample
from contid.targets import Target
from tests.support.fingers import Collector, circle, load

BROKEN_FROM = 250
TICKS = 400
#: Last records of the robot; its servos have stopped then.
END = 20


class BadModel:
    """A model that answers as ever until it is broken, then by the given functions."""

    def __init__(self, model: Any, **broken: Callable[..., Any]) -> None:
        self._model, self._answers = model, broken
        self.broken = False

    def __getattr__(self, name: str) -> Any:
        return self._answers[name] if self.broken and name in self._answers else getattr(self._model, name)


class BadBus:
    """A bus whose exchange is changed when it is broken."""

    def __init__(self, bus: Any, change: Callable[[Mapping[str, Sample]], Any]) -> None:
        self._bus, self._change = bus, change
        self.broken = False

    def __getattr__(self, name: str) -> Any:
        return getattr(self._bus, name)

    def exchange(self, commands: Mapping[str, float]) -> Any:
        samples = self._bus.exchange(commands)
        return self._change(samples) if self.broken else samples


class Run:
    """Two fingers on buses of their own that follow a circle; the second one may be made bad."""

    def __init__(self, on_fault: str = "hold", **keys: Any) -> None:
        self.loaded = load(2, buses=2, on_fault=on_fault, **keys)
        self.collector = Collector(self.loaded)
        self.process = VirtualProcess(
            self.loaded, 200.0, self.collector, trajectory=circle(self.loaded, period_s=5.0), attended=True
        )
        self.bad: list[BadModel | BadBus] = []

    def break_model(self, **broken: Callable[..., Any]) -> None:
        robots = self.process.engine.robots
        good, config = robots.configs
        bad = BadModel(config.model, **broken)
        robots.configs = (good, replace(config, model=bad))
        self.bad.append(bad)

    def break_bus(self, change: Callable[[Mapping[str, Sample]], Any]) -> None:
        port = self.process.ports["bus1"]
        port.bus = BadBus(port.bus, change)
        self.bad.append(port.bus)

    def go(self) -> list[Any]:
        self.process.engine.arm()
        while self.process.tick < TICKS:
            self.process.begin()
            for bad in self.bad:
                bad.broken = self.process.tick >= BROKEN_FROM
            self.process.turn()
        self.process.close()
        return self.collector.records

    def fault(self) -> tuple[str, str]:
        """Name and words of the only fault."""
        (found,) = [event for event in self.collector.events if event["event"] == "fault"]
        assert found["robot"] == "f1"
        return found["name"], found["detail"]


@pytest.fixture(scope="module")
def sound() -> list[str]:
    """The first finger in a run without a defect."""
    run = Run()
    records = run.go()
    assert {record.robots[1].mode for record in records[BROKEN_FROM:]} == {Mode.RUN}
    return [repr((record.tick, record.robots[0])) for record in records]


def unharmed(records: list[Any], sound: list[str]) -> bool:
    return [repr((record.tick, record.robots[0])) for record in records] == sound


def fail(*_: object, **__: object) -> Any:
    raise RuntimeError("no idea")


def leave(*_: object, **__: object) -> Any:
    sys.exit("enough")


MODELS: dict[str, tuple[dict[str, Callable[..., Any]], str]] = {
    "inverse raises": ({"inverse": fail}, "no idea"),
    "forward raises": ({"forward": fail}, "no idea"),
    "both raise": ({"inverse": fail, "forward": fail}, "no idea"),
    "inverse exits": ({"inverse": leave}, "enough"),
    "inverse answers None": ({"inverse": lambda *_: None}, "None"),
    "inverse answers text": ({"inverse": lambda *_: "up"}, "up"),
    "forward answers None": ({"forward": lambda *_: None}, "NoneType"),
}


def changed(**fields: Any) -> Callable[[Any], Callable[..., Any]]:
    """A model whose answers have other fields."""
    return lambda model: lambda target, seed: replace(model.inverse(target, seed), **fields)


ANSWERS: dict[str, tuple[Callable[[Any], Callable[..., Any]], str]] = {
    "too few axes": (changed(actuation=(0.05,)), "(0.05,) for 2 axes"),
    "too many axes": (changed(actuation=(0.05,) * 3), "0.05, 0.05) for 2 axes"),
    "no axes": (changed(actuation=()), "() for 2 axes"),
    "NaN": (changed(actuation=(math.nan, 0.05)), "nan"),
    "text as an axis": (changed(actuation=("left", 0.05)), "left"),
    "None as residual": (changed(residual_m=None), "None"),
    "text as residual": (changed(residual_m="small"), "small"),
    "None as iterations": (changed(iterations=None), "None"),
    "numbers as limits": (changed(limited_by=(7,)), "7"),
}


@pytest.mark.parametrize("on_fault", ["hold", "relax"])
@pytest.mark.parametrize("kind", [*MODELS, *ANSWERS])
def test_a_defect_of_a_model_costs_its_robot_only(sound: list[str], kind: str, on_fault: str) -> None:
    run = Run(on_fault)
    broken, words = MODELS.get(kind, ({}, ""))
    if kind in ANSWERS:
        change, words = ANSWERS[kind]
        broken = {"inverse": change(run.process.engine.robots.configs[1].model)}
    run.break_model(**broken)
    records = run.go()
    assert unharmed(records, sound)
    assert words in run.fault()[1]
    assert {record.robots[1].mode for record in records[BROKEN_FROM + 1 :]} == {Mode.FAULT}
    if on_fault == "relax":
        return
    # It stops as fast as its limits allow, and not faster: no command is left out on the way.
    config = run.process.engine.robots.configs[1]
    for axis, limits in enumerate(config.limits):
        commands = [record.robots[1].axes[axis].command for record in records[BROKEN_FROM - 5 :]]
        steps = [after - before for before, after in pairwise(commands)]
        changes = [abs(after - before) for before, after in pairwise(steps)]
        assert max(changes) <= limits.change * 1.0001
        assert not any(steps[-END:])


SAMPLES: dict[str, tuple[Callable[[Any], Any], str]] = {
    "text": (lambda samples: "fine", "fine"),
    "None": (lambda samples: None, "None"),
    "a number": (lambda samples: 3, "3"),
    "a list": (lambda samples: list(samples.values()), "list"),
    "text as a sample": (lambda samples: dict.fromkeys(samples, "here"), "here"),
    "None as a sample": (lambda samples: dict.fromkeys(samples), "None"),
    "one text as a sample": (lambda samples: {**samples, "f1.left": "here"}, "here"),
    "text as a value": (lambda samples: each(samples, value="far"), "far"),
    "text as an effort": (lambda samples: each(samples, effort="much"), "much"),
    "None as a time": (lambda samples: each(samples, time_s=None), "None"),
    "text as an age": (lambda samples: each(samples, age_s="old"), "old"),
    "None as validity": (lambda samples: each(samples, valid=None), "None"),
    "a number as a fault": (lambda samples: each(samples, fault=7), "7"),
    "it raises": (fail, "no idea"),
    "it exits": (leave, "enough"),
}


def each(samples: Mapping[str, Sample], **fields: Any) -> dict[str, Sample]:
    return {axis: replace(sample, **fields) for axis, sample in samples.items()}


@pytest.mark.parametrize("kind", SAMPLES)
def test_what_a_driver_answers_costs_its_robot_only(sound: list[str], kind: str) -> None:
    run = Run()
    change, words = SAMPLES[kind]
    run.break_bus(change)
    records = run.go()
    assert unharmed(records, sound)
    assert words in run.fault()[1]
    assert {record.robots[1].mode for record in records[BROKEN_FROM + 1 :]} == {Mode.FAULT}


def test_samples_of_axes_of_another_bus_are_not_taken(sound: list[str]) -> None:
    run = Run()
    wrong = Sample(0.0, 0.0, valid=True, age_s=9.0, fault="not mine")
    run.break_bus(lambda samples: {**samples, "f0.left": wrong})
    assert unharmed(run.go(), sound)
    assert not [event for event in run.collector.events if event["event"] == "fault"]


@pytest.mark.parametrize("order", [Hold(), Stop(), Estop(), Grip(0.5), Begin()])
def test_an_order_that_meets_a_defect_ends_nothing(order: Message) -> None:
    """A stop of a robot in motion asks its model; the others obey, and an emergency stop is obeyed by all."""
    run = Run()
    run.break_model(inverse=fail, forward=fail)
    states = ordered(run, order)
    assert states[0].mode is (
        Mode.RUN if isinstance(order, Grip) else Mode.HOLD if order in (Hold(), Begin()) else Mode.OFF
    )
    assert states[1].mode is (Mode.OFF if order == Estop() else Mode.FAULT)
    assert states[1].enabled is (order != Estop())


def ordered(run: Run, order: Message) -> list[RobotState]:
    """The states at the end of a run that is given an order in the tick in which its model is broken."""
    engine = run.process.engine
    engine.arm()
    for tick in range(TICKS):
        run.process.begin()
        if tick == BROKEN_FROM:
            run.bad[0].broken = True
            engine.obey(order, tick)
        run.process.turn()
    run.process.close()
    return engine.robots.states


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
    return sum(range(8_000_000))  # one call, in which no alarm is delivered


@pytest.mark.parametrize("slow", [sleep, compute, compute_in_c])
def test_a_tick_that_takes_too_long_costs_its_robot_only(sound: list[str], slow: Callable[..., Any]) -> None:
    run = Run()
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
    again = Run()
    again.break_model()
    engine = again.process.engine
    engine.arm()
    while again.process.tick < TICKS:
        again.process.begin()
        if again.process.tick == event["tick"]:
            engine.robots.overran["f1"] = event["message"]
        again.process.turn()
    again.process.close()
    assert repr(again.collector.records) == repr(records)


class Streamed(Run):
    """The two fingers on rows instead: at rest on one, from `BROKEN_FROM` on others far from it."""

    def __init__(self) -> None:
        super().__init__()
        self.process.engine.selector.source = None

    def go(self) -> list[Any]:
        engine = self.process.engine
        engine.arm()
        while self.process.tick < TICKS:
            number = self.process.tick
            self.process.begin()
            for bad in self.bad:
                bad.broken = number >= BROKEN_FROM
            if number == 0 or (number >= BROKEN_FROM and number % 40 == 10):
                there = Target(tip_m=(0.05 if number == 0 else 0.04, 0.075, 0.0))
                engine.obey(Rows({"f1": there, "f0": there}), number)
            self.process.turn()
        self.process.close()
        return self.collector.records


@pytest.fixture(scope="module")
def sound_stream() -> list[str]:
    """The first finger of a stream without a defect."""
    run = Streamed()
    records = run.go()
    assert {record.robots[1].mode for record in records[BROKEN_FROM:]} == {Mode.RUN}
    return [repr((record.tick, record.robots[0])) for record in records]


@pytest.mark.parametrize("kind", MODELS)
def test_a_model_that_fails_at_a_row_costs_its_robot_only(sound_stream: list[str], kind: str) -> None:
    """A row that jumps asks the model for a way, before the tick."""
    run = Streamed()
    run.break_model(**MODELS[kind][0])
    records = run.go()
    assert unharmed(records, sound_stream)
    assert any(words in run.fault()[1] for words in (MODELS[kind][1], "'str'"))
    assert not [event for event in run.collector.events if event["event"] == "refused"]


@contextmanager
def alarmed(run: Run) -> Iterator[None]:
    """The alarm of a control process, on the clock of the machine."""
    costs = run.process.engine.costs
    costs.now = time.monotonic
    before = signal.getsignal(signal.SIGALRM)
    TickAlarm(costs, ProcessorWait(), 200.0).install()
    try:
        yield
    finally:
        signal.signal(signal.SIGALRM, before)


def test_a_model_that_is_slow_at_a_row_costs_its_robot_only(sound_stream: list[str]) -> None:
    run = Streamed()
    run.break_model(inverse=sleep)
    began_s = time.monotonic()
    with alarmed(run):
        records = run.go()
    assert time.monotonic() - began_s < 30.0
    assert unharmed(records, sound_stream)
    assert run.fault() == ("MODEL_TOO_SLOW", "its model was interrupted after 100 ms")


@pytest.mark.parametrize("order", [Hold(), Stop(), Estop()])
def test_a_model_that_is_slow_at_an_order_costs_its_robot_only(order: Message) -> None:
    run = Run()
    run.break_model(inverse=sleep, forward=sleep)
    began_s = time.monotonic()
    with alarmed(run):
        states = ordered(run, order)
    assert time.monotonic() - began_s < 30.0
    assert states[0].mode is (Mode.HOLD if order == Hold() else Mode.OFF)
    assert states[1].mode is (Mode.OFF if order == Estop() else Mode.FAULT)
    assert states[1].enabled is (order != Estop())


class NoDriver:
    """A driver that cannot make a bus, or open it, or close it."""

    name, axes = "bus0", ("f0.left", "f0.right")

    def __init__(self, opens: bool) -> None:
        self._opens = opens

    def open_bus(self, *_: object) -> NoDriver:
        if self._opens:
            return self
        raise ValueError("baud rate of tea")

    def open(self) -> None:
        raise KeyError("no such port")

    def close(self) -> None:
        raise RuntimeError("it never was open")


@pytest.mark.parametrize(
    ("opens", "words"), [(False, "ValueError: baud rate of tea"), (True, "no such port")]
)
def test_a_driver_that_fails_to_open_is_reported(
    monkeypatch: pytest.MonkeyPatch, opens: bool, words: str
) -> None:
    monkeypatch.setattr("contid.control.engine.wiring.load_driver", lambda name: NoDriver(opens))
    with pytest.raises(ContidError, match=f"bus bus0: driver 'sim': .*{words}"):
        open_buses(load(1), VirtualClock())


def test_a_tracker_that_fails_is_reported_and_not_read_any_more(caplog: pytest.LogCaptureFixture) -> None:
    class Tracker(NoDriver):
        def measured_tips(self) -> Any:
            raise OSError("no camera")

    trackers = BusTrackers([Tracker(True)])  # type: ignore[list-item]
    for _ in range(3):
        assert not [*trackers.arrived(0.0)]
    assert caplog.text.count("no camera") == 1
