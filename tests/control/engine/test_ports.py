"""A slow or dying bus costs its own robots, never the tick of the others."""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import pytest

from contid.control.engine.cycle import Timing
from contid.control.engine.engine import Engine
from contid.control.engine.messages import Estop, Finish, Resume, Stop
from contid.control.engine.ports import BusJob, BusPort, perform
from contid.control.engine.tick_layout import UNRESTED
from contid.control.engine.wiring import build_robot_configs, open_buses
from contid.control.tick.faults import Fault
from contid.control.tick.state import Effect
from contid.control.tick.supervisor import Mode
from contid.errors import DeviceError
from contid.hal import Bus, Rest, Sample
from contid.robot_file.load import parse_robot_file
from contid_drivers.sim.bus import SimBus
from tests.support.fingers import Collector, fingers, load


class Blocking:
    """A real simulated bus whose exchange can be held up, as a stuck port would."""

    def __init__(self, bus: Bus) -> None:
        self.bus = bus
        self.name = bus.name
        self.axes = bus.axes
        self.free = threading.Event()
        self.free.set()

    def open(self) -> None:
        self.bus.open()

    def enable(self, axes: Sequence[str]) -> None:
        self.bus.enable(axes)

    def exchange(self, commands: Mapping[str, float]) -> Mapping[str, Sample]:
        self.free.wait()
        return self.bus.exchange(commands)

    def disable(self, axes: Sequence[str], rest: Rest) -> None:
        self.bus.disable(axes, rest)

    def clear_fault(self, axes: Sequence[str]) -> None:
        self.bus.clear_fault(axes)

    def close(self) -> None:
        self.bus.close()


class Ticking:
    """A clock that shows a time that is set; the bus is real, the waiting is not."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def now(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds


def test_a_stuck_bus_faults_its_robot_and_the_other_runs_on() -> None:
    loaded = load(2, buses=2)
    clock = Ticking()
    buses = {name: Blocking(bus) for name, bus in open_buses(loaded, clock).items()}
    ports = {name: BusPort(bus, threaded=True) for name, bus in buses.items()}
    seen = Collector()
    engine = Engine(build_robot_configs(loaded, 200.0), ports, 200.0, seen, clock.now, attended=True)
    engine.arm()
    try:
        for tick in range(60):
            clock.now_s = tick / 200.0
            if tick == 40:
                buses["bus0"].free.clear()
            # The end is far away for a healthy bus and near for the stuck one: no timing is asserted.
            timeout_s = 5.0 if tick < 40 else 0.05
            engine.cycle(Timing(tick, 0, clock.now_s, 0.0, clock.now_s + timeout_s))
        assert engine.robots.states[0].mode is Mode.FAULT
        assert engine.robots.states[0].fault is Fault.BUS_STALLED
        assert engine.robots.states[1].mode is Mode.HOLD
    finally:
        buses["bus0"].free.set()
        for port in ports.values():
            port.close(5.0)


@pytest.mark.parametrize("order", [Estop(), Stop()])
@pytest.mark.parametrize("busy", [False, True], ids=["idle", "at an older job"])
def test_the_record_has_that_a_bus_is_still_at_an_order_to_stop(order: Estop | Stop, busy: bool) -> None:
    """Its axes had answered by the record, and the order was answered with ok while they had torque."""
    loaded = load(2, buses=2, on_interrupt="relax")
    clock = Ticking()
    simulated = open_buses(loaded, clock)
    buses = {name: Blocking(bus) for name, bus in simulated.items()}
    ports = {name: BusPort(bus, threaded=True) for name, bus in buses.items()}
    seen = Collector(loaded)
    engine = Engine(build_robot_configs(loaded, 200.0), ports, 200.0, seen, clock.now, attended=True)
    engine.arm()

    def turn(tick: int, timeout_s: float = 5.0) -> tuple[bool, ...]:
        clock.now_s = tick / 200.0
        engine.cycle(Timing(tick, 0, clock.now_s, 0.0, clock.now_s + timeout_s))
        return tuple(bool(robot.flags & UNRESTED) for robot in seen.records[-1].robots)

    try:
        for tick in range(39):
            turn(tick)
        if not busy:
            turn(39)
        buses["bus0"].free.clear()
        if busy:
            turn(39, 0.05)
        engine.obey(order, 40)
        assert turn(40, 0.05) == (True, False)
        buses["bus0"].free.set()
        if busy:
            assert turn(41) == (True, False), "the older job was done, and the request waits for the next"
        assert turn(42) == (False, False)
        bus = simulated["bus0"]
        assert isinstance(bus, SimBus)
        assert not any(device.on for device in bus.devices.values())
    finally:
        buses["bus0"].free.set()
        for port in ports.values():
            port.close(5.0)


@pytest.mark.parametrize("late_s", [0.0, 0.01], ids=["in time", "in a late tick"])
def test_late_buses_share_one_deadline(monkeypatch: pytest.MonkeyPatch, late_s: float) -> None:
    """Eight buses that do not answer cost a tick what one costs: its rest, or a share of a period."""
    loaded = load(8, buses=8)
    clock = Ticking()
    ports = {name: BusPort(bus, threaded=False) for name, bus in open_buses(loaded, clock).items()}
    engine = Engine(build_robot_configs(loaded, 200.0), ports, 200.0, Collector(), clock.now, attended=True)

    def take(port: BusPort, timeout_s: float) -> None:
        clock.now_s += timeout_s
        port.stalls += 1

    monkeypatch.setattr(BusPort, "take", take)
    for port in ports.values():
        port.threaded = True
    clock.now_s = late_s
    engine.cycle(Timing(0, 0, 0.0, late_s, end_s=0.9 / 200.0))
    assert clock.now_s == pytest.approx(max(0.9 / 200.0, late_s + 0.25 / 200.0))


def test_an_estop_that_meets_a_late_bus_is_waited_for_before_the_run_ends() -> None:
    """The bus comes back in the tick of the estop, too late to be asked in it: the next tick asks."""
    loaded = load(1)
    clock = Ticking()
    ((name, bus),) = ((name, Blocking(bus)) for name, bus in open_buses(loaded, clock).items())
    port = BusPort(bus, threaded=True)
    engine = Engine(
        build_robot_configs(loaded, 200.0), {name: port}, 200.0, Collector(), clock.now, attended=True
    )
    engine.arm()
    tick = 0

    def cycle(timeout_s: float) -> None:
        nonlocal tick
        clock.now_s = tick / 200.0
        engine.cycle(Timing(tick, 0, clock.now_s, 0.0, clock.now_s + timeout_s))
        tick += 1

    try:
        for _ in range(20):
            cycle(5.0)
        assert engine.robots.states[0].mode is Mode.HOLD
        bus.free.clear()
        cycle(0.0)
        assert port.busy
        bus.free.set()
        engine.obey(Estop(), tick)
        engine.obey(Finish(), tick)
        while not engine.finished:
            assert tick < 40
            cycle(5.0)
        assert isinstance(bus.bus, SimBus)
        assert not any(device.on for device in bus.bus.devices.values())
    finally:
        bus.free.set()
        port.close(5.0)


def test_an_answer_to_an_older_request_does_not_arm_a_robot() -> None:
    """Armed, stopped and armed again while one of its two buses still enables: both have to be asked anew."""
    text = fingers(1, buses=2).replace("right: {bus: bus0", "right: {bus: bus1")
    loaded = parse_robot_file(text, "two.yaml")
    clock = Ticking()

    class Slow(Blocking):
        def enable(self, axes: Sequence[str]) -> None:
            enabling.acquire()
            super().enable(axes)

        def disable(self, axes: Sequence[str], rest: Rest) -> None:
            resting.wait()
            super().disable(axes, rest)

    enabling, resting = threading.Semaphore(0), threading.Event()
    buses = open_buses(loaded, clock)
    slow = Slow(buses["bus1"])
    ports = {"bus0": BusPort(buses["bus0"], threaded=False), "bus1": BusPort(slow, threaded=True)}
    engine = Engine(build_robot_configs(loaded, 200.0), ports, 200.0, Collector(), clock.now, attended=True)
    tick = 0

    def cycles(count: int, timeout_s: float = 0.0) -> None:
        nonlocal tick
        for _ in range(count):
            clock.now_s = tick / 200.0
            engine.cycle(Timing(tick, 0, clock.now_s, 0.0, clock.now_s + timeout_s))
            tick += 1

    engine.arm()
    try:
        while engine.robots.states[0].mode is not Mode.ARMING:
            cycles(1, 5.0 if tick < 2 else 0.0)
        for message in (Stop(), Resume()):
            engine.obey(message, tick)
            cycles(2)
        assert engine.robots.states[0].mode is Mode.ARMING
        enabling.release()  # the first request; the others wait
        cycles(1, 5.0)
        assert not engine.robots.states[0].enabled
        enabling.release()
        resting.set()
        cycles(2, 5.0)
        assert engine.robots.states[0].mode.name == "HOLD"
    finally:
        enabling.release(9)
        resting.set()
        for port in ports.values():
            port.close(5.0)


def test_a_robot_of_which_one_bus_refuses_to_arm_rests_on_the_other() -> None:
    text = fingers(1, buses=2).replace("right: {bus: bus0", "right: {bus: bus1")
    loaded, clock = parse_robot_file(text, "two.yaml"), Ticking()
    buses = open_buses(loaded, clock)

    class Refusing(Blocking):
        def enable(self, axes: Sequence[str]) -> None:
            raise DeviceError("f0.right", "not today")

    ports = {"bus0": BusPort(buses["bus0"], False), "bus1": BusPort(Refusing(buses["bus1"]), False)}
    engine = Engine(build_robot_configs(loaded, 200.0), ports, 200.0, Collector(), clock.now, attended=True)
    engine.arm()
    for tick in range(20):
        clock.now_s = tick / 200.0
        engine.cycle(Timing(tick, 0, clock.now_s, 0.0, clock.now_s))
    assert engine.robots.states[0].fault is Fault.ARM_REFUSED
    assert isinstance(buses["bus0"], SimBus)
    assert not any(device.on for device in buses["bus0"].devices.values())
    for port in ports.values():
        port.close(5.0)


def test_after_an_error_in_a_tick_only_a_worker_keeps_its_bus() -> None:
    """The error may have come between the start of a job and its end, as that of an alarm does."""
    (bus,) = open_buses(load(1), Ticking()).values()
    assert isinstance(bus, SimBus)
    port = BusPort(bus, threaded=False)
    bus.enable(bus.axes)
    port.busy = True
    port.rest(bus.axes, Rest.RELAX)
    assert not any(device.on for device in bus.devices.values())
    port.close(5.0)


def test_a_refusal_of_one_robot_is_not_a_loss_of_the_bus() -> None:
    loaded = load(2)
    (bus,) = open_buses(loaded, Ticking()).values()

    class Refusing(Blocking):
        def enable(self, axes: Sequence[str]) -> None:
            if "f0.left" in axes:
                raise DeviceError("f0.left", "not today")
            super().enable(axes)

    effects = tuple((i, Effect.ENABLE, (f"f{i}.left", f"f{i}.right")) for i in range(2))
    answer = perform(Refusing(bus), BusJob({}, effects))
    assert answer.lost == ""
    assert answer.samples is not None
    assert [(robot, message) for robot, _, message in answer.refused] == [(0, "f0.left: not today")]
    assert answer.done == [(1, Effect.ENABLE)]
    bus.close()


def test_a_defect_in_the_rest_of_one_robot_does_not_keep_the_others_from_theirs() -> None:
    (bus,) = open_buses(load(2), Ticking()).values()
    assert isinstance(bus, SimBus)

    class Broken(Blocking):
        def disable(self, axes: Sequence[str], rest: Rest) -> None:
            if "f0.left" in axes:
                raise ZeroDivisionError("oh")
            super().disable(axes, rest)

    bus.enable(bus.axes)
    effects = tuple((i, Effect.RELAX, (f"f{i}.left", f"f{i}.right")) for i in range(2))
    answer = perform(Broken(bus), BusJob({}, effects))
    assert answer.lost == "bus0: ZeroDivisionError: oh"
    assert answer.done == [(1, Effect.RELAX)]
    assert {axis for axis, device in bus.devices.items() if device.on} == {"f0.left", "f0.right"}
    bus.close()


def test_a_defect_of_a_driver_is_reported_as_a_lost_bus() -> None:
    loaded = load(1)
    (bus,) = open_buses(loaded, Ticking()).values()

    class Broken(Blocking):
        def exchange(self, commands: Mapping[str, float]) -> Mapping[str, Sample]:
            raise ZeroDivisionError("oh")

    assert perform(Broken(bus), BusJob({})).lost == "bus0: ZeroDivisionError: oh"
    bus.close()


@pytest.mark.parametrize("value", [math.nan, math.inf, None, "left out"])
@pytest.mark.parametrize("since", [0, 40], ids=["from the start", "while armed"])
def test_a_value_that_is_no_number_is_a_failed_read_even_if_marked_valid(value: Any, since: int) -> None:
    loaded = load(1)
    clock = Ticking()
    ((name, bus),) = open_buses(loaded, clock).items()

    class Lying(Blocking):
        def exchange(self, commands: Mapping[str, float]) -> Mapping[str, Sample]:
            assert all(map(math.isfinite, commands.values()))
            samples = dict(super().exchange(commands))
            if tick >= since:
                if value == "left out":
                    del samples["f0.left"]
                else:
                    samples["f0.left"] = replace(samples["f0.left"], value=value)
            return samples

    engine = Engine(
        build_robot_configs(loaded, 200.0), {name: BusPort(Lying(bus), threaded=False)}, 200.0,
        Collector(), clock.now,
        attended=True,
    )  # fmt: skip
    engine.arm()
    for tick in range(500):  # the bus looks at it
        clock.now_s = tick / 200.0
        engine.cycle(Timing(tick, 0, clock.now_s, 0.0, clock.now_s))
    no_number = Fault.AXIS_SILENT if value == "left out" else Fault.IMPLAUSIBLE_SAMPLE
    assert engine.robots.states[0].fault is (no_number if since else Fault.NO_SAMPLE)
    assert bool(engine.robots.states[0].command) == bool(since)
    bus.close()


@pytest.mark.parametrize("effort", [math.nan, math.inf])
def test_an_effort_that_is_no_number_is_none(effort: float) -> None:
    loaded = load(1)
    clock = Ticking()
    ((name, bus),) = open_buses(loaded, clock).items()

    class Lying(Blocking):
        def exchange(self, commands: Mapping[str, float]) -> Mapping[str, Sample]:
            samples = dict(super().exchange(commands))
            return samples | {"f0.left": replace(samples["f0.left"], effort=effort)}

    port = BusPort(Lying(bus), threaded=False)
    engine = Engine(
        build_robot_configs(loaded, 200.0), {name: port}, 200.0, Collector(), clock.now, attended=True
    )
    engine.arm()
    for tick in range(20):
        clock.now_s = tick / 200.0
        engine.cycle(Timing(tick, 0, clock.now_s, 0.0, clock.now_s))
    left = engine.exchange.samples["f0.left"]
    assert (left.valid, left.effort) == (True, None)
    bus.close()
