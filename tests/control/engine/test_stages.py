"""Stages of a tick: found by name, and the fault of a stage is one of its own robots only."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from importlib.metadata import EntryPoint
from itertools import pairwise

import numpy as np
import pytest

from contid.control.engine import stages
from contid.control.engine.cycle import Timing, VirtualClock
from contid.control.engine.engine import Engine
from contid.control.engine.messages import ClearFault, Goto, Resume, Rows, Stop
from contid.control.engine.ports import BusPort
from contid.control.engine.stages import EngineParts, Targets, TickStage
from contid.control.engine.wiring import build_robot_configs, open_buses
from contid.control.tick.faults import Fault
from contid.control.tick.robot_tick import TickResult
from contid.control.tick.supervisor import Mode
from contid.errors import ContidError
from contid.robot_file.base import StopPolicy
from contid.targets import Target
from tests.support.fingers import Collector, load

RATE_HZ = 200.0
NEAR = Target(tip_m=(0.050, 0.075, 0.0))
FAR = Target(tip_m=(0.045, 0.080, 0.0))


class Broken(TickStage):
    """Raises in one of its methods while that is named."""

    raises: str = ""

    def __init__(self, index: int) -> None:
        self.robots = (index,)

    def before(self, targets: Targets, timing: Timing, now_s: float) -> Targets:
        self._raise("before")
        return targets

    def after(self, outcomes: list[TickResult], targets: Targets, now_s: float) -> None:
        self._raise("after")

    def settle(self, now_s: float) -> None:
        self._raise("settle")

    def goto(self, robot: str, target: Target) -> Target:
        self._raise("goto")
        return target

    def _raise(self, method: str) -> None:
        if Broken.raises == method:
            raise RuntimeError("a defect")


def build(index: int, parts: EngineParts) -> TickStage:
    """The builder of the stage."""
    return Broken(index)


class Run:
    """Two fingers, the second with the broken stage, on one simulated bus."""

    def __init__(self) -> None:
        loaded = load(2)
        first, second = build_robot_configs(loaded, RATE_HZ)
        self.clock = VirtualClock()
        self.ports = {
            name: BusPort(bus, threaded=False) for name, bus in open_buses(loaded, self.clock).items()
        }
        configs = [first, replace(second, stages=("broken",))]
        self.engine = Engine(configs, self.ports, RATE_HZ, Collector(), self.clock.now, attended=True)
        self.tick = 0
        self.lengths: list[tuple[float, ...]] = []

    def cycles(self, count: int) -> None:
        for _ in range(count):
            self.clock.set(self.tick / RATE_HZ)
            self.engine.cycle(Timing(self.tick, 0, self.clock.now()))
            self.tick += 1
            self.lengths.append(self.engine.robots.states[1].command)

    def follow(self, targets: Mapping[str, Target]) -> None:
        self.engine.obey(Rows(targets), self.tick)


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Iterator[Run]:
    monkeypatch.setattr(stages, "load_stage", lambda name: build)
    monkeypatch.setattr(Broken, "raises", "")
    made = Run()
    made.engine.arm()
    made.follow({"f0": NEAR, "f1": NEAR})
    made.cycles(400)
    assert all(state.mode is Mode.RUN for state in made.engine.robots.states)
    yield made
    for port in made.ports.values():
        port.close(1.0)


@pytest.mark.parametrize("method", ["before", "after", "settle"])
def test_a_stage_that_raises_stops_its_robot_within_its_limits_and_no_other(
    run: Run, monkeypatch: pytest.MonkeyPatch, method: str
) -> None:
    run.follow({"f0": FAR, "f1": FAR})
    run.cycles(10)
    robots = run.engine.robots
    assert any(robots.states[1].increments)
    monkeypatch.setattr(Broken, "raises", method)
    since = len(run.lengths)
    run.cycles(400)
    first, second = robots.states
    assert (second.mode, second.fault) == (Mode.FAULT, Fault.INTERNAL)
    assert second.message == "Broken: RuntimeError: a defect"
    assert (first.mode, first.fault) == (Mode.RUN, Fault.NONE)
    assert first.command == first.reference
    # It brakes at the limits of its axes: 1 m/s^2, from a tick to the next 25 um.
    steps = [np.subtract(new, old) for old, new in pairwise(run.lengths[since - 2 :])]
    assert max(np.abs(new - old).max() for old, new in pairwise(steps)) <= 1.0 / RATE_HZ**2 * 1.001
    assert not steps[-1].any()


def test_an_order_that_a_stage_cannot_change_is_a_fault_of_its_robot(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Broken, "raises", "goto")
    run.engine.obey(Goto("f1", FAR), run.tick)
    run.cycles(2)
    assert [state.fault for state in run.engine.robots.states] == [Fault.NONE, Fault.INTERNAL]


@pytest.mark.parametrize("method", ["before", "after"])
def test_only_a_person_undoes_the_fault_of_a_stage_and_a_stop_gets_through(
    run: Run, monkeypatch: pytest.MonkeyPatch, method: str
) -> None:
    monkeypatch.setattr(Broken, "raises", method)
    run.cycles(100)
    states = run.engine.robots.states
    run.engine.obey(Resume(), run.tick)  # for all robots: those in FAULT are left
    run.engine.obey(ClearFault(("f1",)), run.tick)
    run.cycles(5)
    assert states[1].fault is Fault.INTERNAL  # the defect is still there
    run.engine.obey(Stop(None, StopPolicy.RELAX), run.tick)
    run.cycles(400)
    assert [state.mode for state in states] == [Mode.OFF, Mode.FAULT]
    assert not any(state.enabled for state in states)
    monkeypatch.setattr(Broken, "raises", "")
    run.cycles(5)
    assert states[1].mode is Mode.FAULT
    run.engine.obey(ClearFault(("f1",)), run.tick)
    run.cycles(5)
    assert (states[1].mode, states[1].fault) == (Mode.READY, Fault.NONE)


def test_a_stage_that_is_not_installed_is_an_error_with_its_name() -> None:
    with pytest.raises(ContidError, match=r"stage 'gravity'.*not installed"):
        stages.load_stage("gravity")


def test_a_stage_whose_extra_was_left_out_names_what_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    point = EntryPoint("gravity", "contid_left_out.stage:build", stages.ENTRY_POINT_GROUP)
    monkeypatch.setattr(stages, "entry_points", lambda **_: [point])
    with pytest.raises(ContidError, match=r"'gravity'.*needs contid_left_out: install"):
        stages.load_stage("gravity")
