"""Two fingers in virtual time, of which the second one's model or bus is broken from a tick on.

The witness of the other robot is its records: the same to the bit as in a run without the defect.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from contid.control.engine.messages import Message, Rows
from contid.control.engine.virtual import VirtualProcess
from contid.control.tick.state import RobotState
from contid.control.tick.supervisor import Mode
from contid.hal import Sample
from contid.targets import Target
from tests.support.fingers import Collector, circle, load

BROKEN_FROM = 150
TICKS = 270
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


class BrokenRun:
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


class StreamedRun(BrokenRun):
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


def good_of(run: BrokenRun) -> list[str]:
    """The records of the first finger in a run without a defect."""
    records = run.go()
    assert {record.robots[1].mode for record in records[BROKEN_FROM:]} == {Mode.RUN}
    return [repr((record.tick, record.robots[0])) for record in records]


def unharmed(records: list[Any], sound: list[str]) -> bool:
    return [repr((record.tick, record.robots[0])) for record in records] == sound


def ordered(run: BrokenRun, order: Message) -> list[RobotState]:
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


def fail(*_: object, **__: object) -> Any:
    raise RuntimeError("no idea")


def leave(*_: object, **__: object) -> Any:
    sys.exit("enough")


#: What a model answers to any question, and the words of its fault.
MODELS: dict[str, tuple[dict[str, Callable[..., Any]], str]] = {
    "inverse raises": ({"inverse": fail}, "no idea"),
    "forward raises": ({"forward": fail}, "no idea"),
    "both raise": ({"inverse": fail, "forward": fail}, "no idea"),
    "inverse exits": ({"inverse": leave}, "enough"),
    "inverse answers None": ({"inverse": lambda *_: None}, "None"),
    "inverse answers text": ({"inverse": lambda *_: "up"}, "up"),
    "forward answers None": ({"forward": lambda *_: None}, "NoneType"),
}
