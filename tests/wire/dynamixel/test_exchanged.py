"""Servos and adapters that come back exchanged: the orders of one robot never move the other."""

from __future__ import annotations

import random
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path

import pytest

from contid.errors import DeviceError, DeviceNotFoundError
from contid.hal import AxisOnBus, Rest
from contid.kit import remembered
from contid_devices.dynamixel import TOOLS
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.bus import DynamixelBus
from contid_drivers.dynamixel.options import DynamixelAxisOptions, DynamixelBusOptions
from contid_emulate.dynamixel import Servo
from tests.wire.dynamixel.virtual_wire import InlineEmulator, servo_time
from tests.wire.wire_time import WireTime

COUNT = 2


@dataclass
class Robots:
    """Two equal robots, each with its bus and its servos; ``emulators`` are the adapters."""

    time: WireTime
    emulators: list[InlineEmulator]
    own: list[tuple[Servo, ...]]
    options: list[DynamixelBusOptions]
    axes: list[list[AxisOnBus]]

    def bus(self, which: int) -> DynamixelBus:
        return DynamixelBus(f"servos{which}", self.options[which], self.axes[which], self.time)

    def state(self, which: int) -> list[tuple[int, int, float]]:
        """What orders change: torque, goal and shaft of the servos of a robot."""
        return [
            (servo.get(reg.TORQUE_ENABLE), servo.get(reg.GOAL_POSITION), servo.position_ticks)
            for servo in self.own[which]
        ]

    def drive(self, which: int) -> bool:
        """Order a robot to move; whether it was armed."""
        bus = self.bus(which)
        try:
            bus.open()
            bus.enable(bus.axes)
            samples = bus.exchange({})
            for _ in range(3):
                bus.exchange({axis: (sample.value or 0.0) + 0.3 for axis, sample in samples.items()})
            bus.disable(bus.axes, Rest.RELAX)
        except DeviceError:
            return False
        finally:
            bus.close()
        return True


@pytest.fixture
def robots(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Robots]:
    monkeypatch.setattr(remembered, "EMULATED", "/none/")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)
    clock = servo_time(monkeypatch)
    with ExitStack() as stack:
        emulators, own, options, axes = [], [], [], []
        for which in range(2):
            made = tuple(Servo(i + 1, position_ticks=1000.0 * (i + 1)) for i in range(COUNT))
            for servo in made:
                servo.put(reg.RETURN_DELAY, 0)
            emulator = InlineEmulator(made, tmp_path / f"port{which}", paced=False)
            emulators.append(stack.enter_context(emulator))
            own.append(made)
            options.append(DynamixelBusOptions(port=emulator.port))
            axes.append(
                [AxisOnBus(f"r{which}.a{i + 1}", DynamixelAxisOptions(id=i + 1)) for i in range(COUNT)]
            )
        clock.devices = emulators
        yield Robots(clock, emulators, own, options, axes)


def test_exchanged_adapters_are_refused_until_a_person_accepts_them(robots: Robots) -> None:
    assert robots.drive(0)
    assert robots.drive(1)
    first, second = robots.emulators
    first.servos, second.servos = second.servos, first.servos
    before = robots.state(1)
    with pytest.raises(DeviceNotFoundError, match=r"belongs to bus servos1 at .*port1") as refused:
        robots.bus(0).open()
    assert "--accept servos0" in refused.value.remedy
    assert robots.state(1) == before
    findings = {each.subject: each for each in TOOLS.doctor("servos0", robots.options[0], robots.axes[0])}
    assert not findings["servos0 identity"].ok
    assert "--accept servos0" in findings["servos0 identity"].remedy
    for which in range(2):
        TOOLS.accept(f"servos{which}", robots.options[which], robots.axes[which], print)
    assert robots.drive(0)
    assert robots.drive(1)


def test_cables_exchanged_under_a_run_are_found_before_arming(robots: Robots) -> None:
    assert robots.drive(1)
    bus = robots.bus(0)
    bus.open()
    bus.exchange({})
    first, second = robots.emulators
    first.servos, second.servos = second.servos, first.servos
    before = robots.state(1)
    with pytest.raises(DeviceError, match="another servo answers"):
        bus.enable(bus.axes)
    with pytest.raises(DeviceError, match="another servo answers"):
        bus.clear_fault(bus.axes)
    bus.close()
    assert robots.state(1) == before


def test_a_servo_under_torque_is_marked_later(robots: Robots) -> None:
    robots.own[0][0].put(reg.TORQUE_ENABLE, 1)
    bus = robots.bus(0)
    bus.open()
    bus.close()
    assert robots.own[0][0].get(reg.MAX_POSITION) == 4095
    robots.own[0][0].put(reg.TORQUE_ENABLE, 0)
    assert robots.drive(0)
    marks = {(servo.get(reg.MAX_POSITION), servo.get(reg.MIN_POSITION)) for servo in robots.own[0]}
    assert len(marks) == COUNT
    assert (4095, 0) not in marks


@pytest.mark.parametrize("damage", ["cut", "unreadable"])
def test_a_damaged_file_loses_no_other_robot(robots: Robots, damage: str) -> None:
    assert robots.drive(0)
    assert robots.drive(1)
    for path in remembered.state_folder().glob("*.json"):
        if "servos0" in path.read_text():
            path.write_bytes(b"" if damage == "cut" else b"\xff{")
    assert robots.drive(0)
    first, second = robots.emulators
    first.servos, second.servos = second.servos, first.servos
    for path in remembered.state_folder().glob("*.json"):
        if "servos0" in path.read_text():
            path.write_bytes(path.read_bytes()[:40])
    assert not robots.drive(0)


def test_without_rights_a_robot_runs_and_it_is_logged(
    robots: Robots, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", "/proc/none")
    assert robots.drive(0)
    assert "not remembered" in caplog.text


#: What a robot did when the cables were pulled.
STATES = ("off", "open", "hold", "run", "relaxed")
#: Exchanges without an answer until the daemon has faulted and rests its robots.
SILENT = 7
#: What a reading is rounded by [ticks].
STANDS = 2


def into(bus: DynamixelBus, state: str) -> None:
    """Bring a robot into a state."""
    if state == "off":
        return
    bus.open()
    samples = bus.exchange({})
    if state == "open":
        return
    bus.enable(bus.axes)
    if state == "run":
        for step in range(1, 4):
            bus.exchange({axis: (sample.value or 0.0) + 0.1 * step for axis, sample in samples.items()})
    if state == "relaxed":
        bus.disable(bus.axes, Rest.RELAX)


def pulled(bus: DynamixelBus, state: str, rest: Rest) -> None:
    """What a daemon does with a robot whose servos are silent: it faults, and rests it."""
    if state == "off":
        return
    for _ in range(SILENT):
        bus.exchange({})
    bus.disable(bus.axes, rest)


def moved(before: tuple[int, int, float], after: tuple[int, int, float]) -> bool:
    """Whether torque was switched, or a goal written that is not where the servo stands."""
    torque, goal, shaft = after
    return torque != before[0] or (goal != before[1] and abs(goal - shaft) > STANDS)


@pytest.mark.timeout(3600)
@pytest.mark.parametrize(
    "count", [pytest.param(4, marks=pytest.mark.slow), pytest.param(200, marks=pytest.mark.campaign)]
)
def test_random_exchanges_in_any_state_never_move_the_other_robot(robots: Robots, count: int) -> None:
    """Cables are out until a daemon faults; then each bus goes on, is cleared and armed again."""
    chance = random.Random(464 + count)
    for which in range(2):
        assert robots.drive(which)
    wrong = []
    for number in range(count):
        states, buses = [chance.choice(STATES) for _ in range(2)], [robots.bus(which) for which in range(2)]
        rests = [chance.choice([Rest.HOLD, Rest.RELAX]) for _ in range(2)]
        for bus, state in zip(buses, states, strict=True):
            into(bus, state)
        for emulator in robots.emulators:
            emulator.servos = ()
        for bus, state, rest in zip(buses, states, rests, strict=True):
            pulled(bus, state, rest)
        robots.time.sleep(0.01)  # what was sent last is lost, too
        chosen = [list(servos) for servos in robots.own]
        exchanged = chance.choice([(0,), (1,), (0, 1)])
        for i in exchanged:
            chosen[0][i], chosen[1][i] = chosen[1][i], chosen[0][i]
        for servo in (*robots.own[0], *robots.own[1]):
            if chance.random() < 0.3:
                servo.reboot()
                servo.booted_at = servo.now
        for emulator, servos in zip(robots.emulators, chosen, strict=True):
            emulator.servos = tuple(servos)
        before = [robots.state(which) for which in range(2)]
        for which in chance.sample(range(2), 2):
            bus = buses[which]
            with suppress(DeviceError):
                bus.open()
            for order in (None, bus.clear_fault, bus.enable):
                with suppress(DeviceError):
                    if order is not None:
                        order(bus.axes)
                with suppress(DeviceError):
                    for _ in range(2):
                        found = bus.exchange({})
                        bus.exchange({axis: (each.value or 0.0) + 0.3 for axis, each in found.items()})
        after = [robots.state(which) for which in range(2)]
        for i in exchanged:
            if any(moved(old[i], new[i]) for old, new in zip(before, after, strict=True)):
                wrong.append(f"{number}: {states} {rests}, servo {i}: {before} {after}")
        for bus in buses:
            bus.close()
        for emulator, own in zip(robots.emulators, robots.own, strict=True):
            emulator.servos = own
        for which in range(2):
            bus = robots.bus(which)
            bus.open()
            bus.exchange({})
            bus.clear_fault(bus.axes)
            bus.close()
    assert wrong == []


@pytest.mark.slow
def test_random_exchanges_never_move_the_other_robot(robots: Robots) -> None:
    chance = random.Random(463)
    assert robots.drive(0)
    assert robots.drive(1)
    armed = exchanges = 0
    while exchanges < 200:
        chosen = [list(servos) for servos in robots.own]
        for i in chance.choice([(0,), (1,), (0, 1)]):
            chosen[0][i], chosen[1][i] = chosen[1][i], chosen[0][i]
        for servo in (*robots.own[0], *robots.own[1]):
            if chance.random() < 0.5:
                servo.reboot()
                servo.booted_at = servo.now
            servo.motion.position += chance.choice([0.0, 50.0, 3000.0])
        for emulator, servos in zip(robots.emulators, chosen, strict=True):
            emulator.servos = tuple(servos)
        which = chance.randrange(2)
        before = robots.state(1 - which)
        armed += robots.drive(which)
        assert robots.state(1 - which) == before
        exchanges += 1
    assert armed == 0
    for emulator, own in zip(robots.emulators, robots.own, strict=True):
        emulator.servos = own
    assert robots.drive(0)
    assert robots.drive(1)


def test_a_servo_that_moves_with_another_one_is_refused_by_name(robots: Robots) -> None:
    stray = Servo(7)
    stray.put(reg.RETURN_DELAY, 0)
    stray.put(reg.SECONDARY_ID, 1)
    robots.emulators[0].servos = (*robots.own[0], stray)
    with pytest.raises(DeviceNotFoundError, match=r"id 7 has the secondary id \(12\) 1") as refused:
        robots.bus(0).open()
    assert "servo write 7 secondary_id 255" in refused.value.remedy
    stray.put(reg.SECONDARY_ID, 255)
    assert robots.drive(0)
