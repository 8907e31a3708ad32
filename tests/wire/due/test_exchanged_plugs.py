"""Boards that come back behind each other's names, in any state: no order of one robot moves the other."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass
from pathlib import Path

import pytest

from contid.errors import DeviceError
from contid.hal import AxisOnBus, Rest
from contid.kit import remembered
from contid_devices.due.homing import home, park
from contid_devices.due.pulses import pulsed_bus
from contid_drivers.due.bus import DueBus
from contid_drivers.due.options import DueAxisOptions, DueBusOptions, Role
from tests.wire.due.lockstep_boards import Body, LockstepBoard, Plugs, board_time
from tests.wire.wire_time import WireTime

#: What a robot did when the cables were pulled: between runs, before arming, at a hold, in a run, at rest, in
#: a fault of its own, after the pulses of a bring-up, in the middle of a search for its end stop.
STATES = ("off", "open", "hold", "run", "relaxed", "fault", "pulsed", "homing")
#: A shaft that is braked or coasts has come to rest, and every watchdog has tripped [s].
SETTLED_S = 1.5
#: What a shaft may tremble by [counts].
STANDS = 2.0
#: The third board is of the same kind with another identity, the last one a Teensy (other bridges and parts).
TEENSY = ("--bridges", "9", "--capabilities", "2")


def axes_of(robot: str) -> list[AxisOnBus]:
    """A motor that is parked, and one that has an end stop; both robots are equal."""
    homing = {"direction": -1, "at_deg": 0.0, "speed_deg_s": 90.0}
    options = [
        {"channel": "m0", "power_up_deg": 90.0},
        {"channel": "m1", "power_up_deg": 20.0, "homing": homing},
    ]
    return [
        AxisOnBus(f"{robot}.{name}", DueAxisOptions.model_validate(each), (-3.0, 12.0))
        for name, each in zip(("parked", "homed"), options, strict=True)
    ]


@dataclass
class Lab:
    """Two equal robots, each with its bus and its board, and two boards more."""

    time: WireTime
    plugs: Plugs
    boards: list[LockstepBoard]
    options: list[DueBusOptions]
    axes: list[list[AxisOnBus]]

    def bus(self, which: int) -> DueBus:
        return DueBus(f"board{which}", self.options[which], self.axes[which], self.time)

    def given(self, which: int) -> tuple[str, DueBusOptions, list[AxisOnBus]]:
        return f"board{which}", self.options[which], self.axes[which]

    def bodies(self, board: LockstepBoard) -> list[Body]:
        return [board.body(channel) for channel in range(2)]

    def drive(self, which: int) -> None:
        """Home, park and move a robot with its own board."""
        home(*self.given(which), [self.axes[which][1].name], print)
        park(*self.given(which), [self.axes[which][0].name], print)
        with closing(self.bus(which)) as bus:
            into(self, bus, which, "run")
            bus.disable(bus.axes, Rest.RELAX)


def into(lab: Lab, bus: DueBus, which: int, state: str) -> None:
    """Bring a robot into a state."""
    if state == "pulsed":
        with pulsed_bus(*lab.given(which)) as pulsed:
            pulsed.pulse(bus.axes[0], 0.1, 0.03)
    if state in ("off", "pulsed"):
        return
    bus.open()
    samples = bus.exchange({})
    bus.clear_fault(bus.axes)
    if state == "homing":
        bus.home(bus.axes[1:])
        follow(lab, bus, {}, 0.05)
    if state in ("hold", "run", "relaxed", "fault"):
        bus.enable(bus.axes)
        goals = {axis: (sample.value or 0.0) + 0.5 for axis, sample in samples.items()}
        follow(lab, bus, {} if state == "hold" else goals, 0.2)
    if state == "relaxed":
        bus.disable(bus.axes, Rest.RELAX)
    if state == "fault":
        lab.time.sleep(SETTLED_S)  # its watchdog stops it


def follow(lab: Lab, bus: DueBus, goals: dict[str, float], seconds: float) -> None:
    """Ticks of a run."""
    until_s = lab.time.now() + seconds
    while lab.time.now() < until_s:
        bus.exchange(goals)
        lab.time.sleep(5e-3)


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Lab]:
    monkeypatch.setattr(remembered, "EMULATED", "/none/")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)
    time = board_time(monkeypatch)
    names = [tmp_path / f"port{which}" for which in range(2)]
    axes = [axes_of(f"r{which}") for which in range(2)]
    options = [DueBusOptions(port=str(name), role=Role.MOTOR) for name in names]
    with ExitStack() as stack:
        parts = ((), (), (), TEENSY)
        boards = [stack.enter_context(LockstepBoard(i + 1, axes[0], each)) for i, each in enumerate(parts)]
        plugs = stack.enter_context(Plugs(names, boards))
        time.devices = [plugs]
        yield Lab(time, plugs, boards, options, axes)


def orders(lab: Lab, bus: DueBus, which: int, chance: random.Random) -> list[Callable[[], object]]:
    """What a daemon and its commands may order, in any order; the bus is open or lost, and may be opened."""
    parked, homed = bus.axes
    goals = {axis: chance.choice([-1.0, 1.0]) for axis in bus.axes}

    def pulse() -> None:
        with pulsed_bus(*lab.given(which)) as pulsed:
            pulsed.pulse(parked, 0.2, 0.03)

    session: list[Callable[[], object]] = [
        lambda: bus.clear_fault(bus.axes),
        lambda: bus.enable(bus.axes),
        lambda: follow(lab, bus, goals, 0.1),
        lambda: bus.home([homed]),
        lambda: bus.park([parked]),
        lambda: bus.pulse(parked, 6000, 30),
        lambda: bus.disable(bus.axes, chance.choice([Rest.HOLD, Rest.RELAX])),
    ]
    chance.shuffle(session)
    opened: list[Callable[[], object]] = [bus.open, *session[:3], bus.close]
    commands: list[Callable[[], object]] = [
        pulse,
        lambda: home(*lab.given(which), [homed], lambda _line: None),
        lambda: park(*lab.given(which), [parked], lambda _line: None),
    ]
    return [*session, *opened, *chance.sample(commands, 2)]


def exchange(lab: Lab, chance: random.Random) -> str:
    """Pull both cables and plug them otherwise; how."""
    first, second, other, teensy = lab.boards
    how = chance.choice(["each other's", "each other's", "another", "a Teensy", "one of them"])
    behind: dict[str, list[LockstepBoard | None]] = {
        "each other's": [second, first],
        "another": [other, first],
        "a Teensy": [teensy, first],
        "one of them": chance.choice([[None, first], [second, None]]),
    }
    lab.plugs.behind = behind[how]
    return how


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("count", [3, pytest.param(200, marks=pytest.mark.campaign)])
def test_exchanged_boards_never_move_the_other_robot(lab: Lab, count: int) -> None:
    chance = random.Random(463 + count)
    wrong = []
    for number in range(count):
        for which in range(2):
            lab.drive(which)
        states, buses = [chance.choice(STATES) for _ in range(2)], [lab.bus(which) for which in range(2)]
        for which, (bus, state) in enumerate(zip(buses, states, strict=True)):
            into(lab, bus, which, state)
        unplugged = chance.random() < 0.7  # a USB plug; else the wires of a port that stays open
        if unplugged:
            lab.plugs.unplug()
        lab.plugs.behind = [None, None]
        lab.time.sleep(SETTLED_S)
        for board in lab.boards:
            if chance.random() < 0.4:
                board.command(chance.choice(["power_cycle", "reset"]))
        lab.time.sleep(0.1)
        ticking = chance.random() < 0.5
        for bus, state in zip(buses, states, strict=True):
            if ticking and state not in ("off", "pulsed"):
                with suppress(DeviceError):
                    for _ in range(3):
                        bus.exchange({})
                with suppress(DeviceError):
                    bus.disable(bus.axes, chance.choice([Rest.HOLD, Rest.RELAX]))
        how = exchange(lab, chance)
        if unplugged:
            lab.plugs.plug()
        before = [lab.bodies(board) for board in lab.boards]
        for which in chance.sample(range(2), 2):
            for order in orders(lab, buses[which], which, chance):
                with suppress(DeviceError):
                    order()
                after = [lab.bodies(board) for board in lab.boards]
                for board, old, new in zip(lab.boards, before, after, strict=True):
                    if any(changed(a, b) for a, b in zip(old, new, strict=True)):
                        wrong.append(
                            f"{number}: {states} {how} {unplugged=} {ticking=} host {which}: "
                            f"{board.chip} {old} {new}"
                        )
                before = after
        for bus in buses:
            bus.close()
        lab.plugs.behind = [*lab.boards[:2]]
    assert wrong == []


def changed(before: Body, after: Body) -> bool:
    """Whether a motor was switched, driven or moved."""
    return after.drive != before.drive or abs(after.shaft - before.shaft) > STANDS


@pytest.mark.process
@pytest.mark.parametrize("order", ["home", "relax", "hold", "park", "clear"])
def test_orders_after_a_silence_find_another_board_first(lab: Lab, order: str) -> None:
    """The wires of two boards are exchanged at ports that stay open: only a demand reaches the other one."""
    for which in range(2):
        lab.drive(which)
    with closing(lab.bus(0)) as bus, closing(lab.bus(1)) as other:
        into(lab, other, 1, "hold")
        other.disable(other.axes, Rest.HOLD)
        into(lab, bus, 0, "open")
        lab.plugs.behind.reverse()
        lab.time.sleep(0.2)
        before = lab.bodies(lab.boards[1])
        orders = {
            "home": lambda: bus.home(bus.axes[1:]),
            "relax": lambda: bus.disable(bus.axes, Rest.RELAX),
            "hold": lambda: bus.disable(bus.axes, Rest.HOLD),
            "park": lambda: bus.park(bus.axes[:1]),
            "clear": lambda: bus.clear_fault(bus.axes),
        }
        with suppress(DeviceError):
            orders[order]()
        lab.time.sleep(0.2)
        after = lab.bodies(lab.boards[1])
        assert not any(changed(a, b) for a, b in zip(before, after, strict=True)), (before, after)
        with pytest.raises(DeviceError, match="or exchanged"):
            bus.exchange({})
