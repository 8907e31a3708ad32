"""The laboratory on wires: emulated servos, the Due's firmware on ptys, fault switches, eyes on the devices.

Hand (Dynamixel), tri-rack (Due, motors) and CBHA (two Due boards, pressures) in one robot file, or hand and
tendon robot (nine servos). What the devices received and did is checked on their side of the wire, not on
the driver's.
"""

from __future__ import annotations

import os
import random
import threading
import time
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

import yaml

from benchmarks.lab import MEMBERS, lab_text
from contid.control.engine.wiring import WiredBus, wired_buses
from contid.hal import DeviceKind
from contid.robot_file.load import LoadedFile, load_robot_file
from contid_drivers.due.emulator import DueEmulator as Board
from contid_drivers.due.options import DueBusOptions as DueOptions
from contid_drivers.due.wiring import axis_options
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.emulator.bench import Bench
from contid_drivers.dynamixel.emulator.servo import Servo
from contid_drivers.dynamixel.options import DynamixelBusOptions as ServoOptions

RATE_HZ: Final = 100.0
#: The emulators share two cores with everything else: long timeouts, so that only injected faults occur.
TOLERANCE_TICKS: Final = 20
LONG_TIMEOUTS: Final = {
    "dynamixel": {"usb_latency_ms": 15, "watchdog_ms": 400},
    "due": {"latency_ms": 15, "watchdog_ms": 400},
}
#: Of SCHED_FIFO, below the control process, as `contid emulate` has it.
PRIORITY: Final = 40
#: How often the boards are looked at.
LOOK_S: Final = 0.02
#: Age of what a servo read of itself [s]; ticks that a wire may lose in a row before its robot is in FAULT.
OLD_S: Final = 0.03
AHEAD_TICKS: Final = 2 * TOLERANCE_TICKS
#: Below the first a chamber is empty; by the second a pressure has fallen [Pa].
EMPTY_PA: Final = 3_000.0
FALLEN_PA: Final = 1_000.0
#: What a board's outputs do (firmware/host/README.md).
DRIVES: Final = 2


@dataclass(frozen=True)
class Switch:
    """One fault switch.

    Attributes:
        name: of the emulator.
        on: axes it is for; empty for the whole bus.
        must: a robot that is watched goes to FAULT when it stays on.
        ticks: within this number of them, on top of those a bus takes to answer.
    """

    name: str
    on_axis: bool
    must: bool = False
    ticks: int = TOLERANCE_TICKS + 1


SERVO_SWITCHES: Final = (
    Switch("silent", True, True), Switch("overload", True, True, 2), Switch("alert", True, True, 2),
    Switch("brownout", True, True), Switch("trip", True, True, 2), Switch("unplug", False, True, 2),
    Switch("drop", True), Switch("corrupt", True), Switch("duplicate", True), Switch("delay", True),
    Switch("echo", False), Switch("late", False), Switch("latency", False), Switch("chunks", False),
    Switch("hiccup", False), Switch("host", False), Switch("jam", True), Switch("freeze", True),
)  # fmt: skip
#: Values of the adapter's switches, and those that switch them off.
ADAPTER: Final[dict[str, tuple[dict[str, float], ...]]] = {
    "late": ({"ms": 3.0}, {"ms": 12.0}), "latency": ({"ms": 1.0}, {"ms": 16.0}), "host": ({"hz": 20.0},),
    "chunks": ({"count": 7},), "hiccup": ({"ms": 4.0}, {"ms": 30.0}, {"ms": 120.0}),
}  # fmt: skip
BOARD_SWITCHES: Final = (
    Switch("silent", True, True), Switch("mute", False, True), Switch("reset", False, True),
    Switch("brown_out", False, True), Switch("freeze", False, True), Switch("unplug", False, True, 2),
    Switch("garbage", False),
)  # fmt: skip
MOTOR_SWITCHES: Final = (
    *BOARD_SWITCHES, Switch("bridge", True), Switch("stall", True), Switch("encoder_stuck", True),
    Switch("encoder_reversed", True),
)  # fmt: skip
REGULATOR_SWITCHES: Final = (*BOARD_SWITCHES, Switch("leak", True), Switch("wire", True))


def robot_file(
    folder: Path,
    on_interrupt: Mapping[str, str] | None = None,
    driver: str = "",
    members: Sequence[str] = MEMBERS,
) -> Path:
    """The laboratory's file, its ports in a folder; with a ``driver`` only its buses and their robots."""
    raw = yaml.safe_load(lab_text(RATE_HZ, ".emulated", members))
    raw["buses"] = {name: bus for name, bus in raw["buses"].items() if driver in ("", bus["driver"])}
    raw["robots"] = {
        name: robot
        for name, robot in raw["robots"].items()
        if all(axis["bus"] in raw["buses"] for axis in robot["axes"].values())
    }
    for name, bus in raw["buses"].items():
        bus |= {"port": f"{folder}/{name}.tty", "tolerance_ticks": TOLERANCE_TICKS} | LONG_TIMEOUTS[
            bus["driver"]
        ]
    for name, robot in raw["robots"].items():
        robot.pop("placeholder", None)
        robot["stop"]["on_interrupt"] = (on_interrupt or {}).get(name, robot["stop"]["on_interrupt"])
    path = folder / "lab.yaml"
    path.write_text(yaml.safe_dump(raw, sort_keys=False, default_flow_style=None))
    return path


@dataclass
class ServoEyes:
    """What one servo received: every goal under torque, in ticks of its shaft."""

    servo: Servo
    axis: str
    low: float
    high: float
    wrong: list[str] = field(default_factory=list)
    goals: list[tuple[float, bool, str]] = field(default_factory=list)
    torque_off_s: float = 0.0

    def __post_init__(self) -> None:
        accept = self.servo._accept

        def watched(register: reg.Register, value: int) -> None:
            was = self.servo.torque
            accept(register, value)
            self._saw(register, was)

        self.servo._accept = watched  # type: ignore[method-assign]

    def _saw(self, register: reg.Register, was: bool) -> None:
        servo = self.servo
        # What a host can see: a frozen encoder hides where the shaft is.
        position = servo.position_ticks if servo.frozen is None else float(servo.read_position())
        if register is reg.TORQUE_ENABLE:
            if servo.torque and not was:
                off = abs(servo.motion.goal - position)
                if off > 2.0:
                    self.wrong.append(f"{self.axis}: torque on {off:.0f} ticks away from its goal")
            elif was and not servo.torque:
                self.torque_off_s = time.monotonic()
        elif register is reg.GOAL_POSITION and servo.torque:
            goal = servo.motion.goal
            if not self.low - 1.0 <= goal <= self.high + 1.0:
                self.wrong.append(f"{self.axis}: goal {goal} outside {self.low:.0f}..{self.high:.0f}")
            # To stay where it is brakes, and moves nothing: how a servo is armed again, or left holding. What
            # it read of itself to do so is some milliseconds old.
            here = abs(goal - position) <= 2.0 + OLD_S * abs(servo.motion.velocity)
            where = f"then at {servo.position_ticks:.0f}, {servo.motion.velocity:.0f} ticks/s"
            self.goals.append((goal, here, where))

    def foreign(self, commands: Iterable[float]) -> list[str]:
        """Goals that are no command of the record (device values [rad]), or not in its order."""
        ticks = [value / reg.RAD_PER_TICK for value in commands if value == value]
        at = 0
        for number, (goal, here, where) in enumerate(self.goals):
            found = next((n for n in range(at, len(ticks)) if abs(ticks[n] - goal) <= 1.0), None)
            if found is not None and not (here and found > at + AHEAD_TICKS):
                at = found
            elif not here:
                return [f"{self.axis}: goal {goal:.0f}, number {number}, was not commanded; {where}"]
        return []

    @property
    def powered(self) -> bool:
        return self.servo.torque


@dataclass
class ChannelEyes:
    """What one output of a board did."""

    board: Board
    axis: str
    number: int
    motor: bool
    low: float  # counts, or Pa
    high: float
    speed: float  # largest [counts/s]; of a pressure none is stated
    wrong: list[str] = field(default_factory=list)
    powered: bool = False
    off_s: float = 0.0
    value: float = 0.0
    speed_now: float = 0.0  # [counts/s]
    seen: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=500))

    def look(self) -> None:
        shaft, speed, pressure, _, drive, *_ = map(float, self.board.command(f"get {self.number}").split())
        now_s, now = time.monotonic(), drive == DRIVES
        if self.powered and not now:
            self.off_s = now_s
        self.powered = now
        self.value = shaft if self.motor else pressure
        self.seen.append((now_s, self.value))
        self.speed_now = speed
        if not self.low <= self.value <= self.high:
            self.wrong.append(f"{self.axis}: at {self.value:.0f}, allowed {self.low:.0f}..{self.high:.0f}")
        if self.motor and abs(speed) > self.speed:
            self.wrong.append(f"{self.axis}: {speed:.0f} counts/s, allowed {self.speed:.0f}")


class Wires:
    """Context manager: every bus of the file is alive while it lasts."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.loaded: LoadedFile = load_robot_file(path)
        self.buses: dict[str, WiredBus] = {bus.wiring.name: bus for bus in wired_buses(self.loaded)}
        self.benches: dict[str, Bench] = {}
        self.boards: dict[str, Board] = {}
        self.servos: list[ServoEyes] = []
        self.channels: list[ChannelEyes] = []
        self._stack = ExitStack()
        self._ended = threading.Event()

    def __enter__(self) -> Self:
        before = os.sched_getscheduler(0), os.sched_getparam(0)
        self._stack.callback(os.sched_setscheduler, 0, *before)
        with suppress(OSError):  # threads and processes inherit it
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
        try:
            for name, bus in self.buses.items():
                self._start(name, bus)
            watcher = threading.Thread(target=self._watch, name="eyes on boards")
            watcher.start()
            self._stack.callback(watcher.join)
            self._stack.callback(self._ended.set)
        except BaseException:
            self._stack.close()
            raise
        with suppress(OSError):
            # Every thread shares its interpreter with the emulators: preempted, it would keep them waiting.
            alone = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
            os.sched_setscheduler(0, alone, os.sched_param(PRIORITY - 1))
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: TracebackType | None) -> None:
        self._stack.close()

    def _start(self, name: str, bus: WiredBus) -> None:
        from contid.control.engine.wiring import build_robot_configs

        options = bus.wiring.options
        configs = build_robot_configs(self.loaded, RATE_HZ)
        scales = {axis: _scale(config, index) for config in configs for index, axis in enumerate(config.axes)}
        limits = {
            axis: limit for config in configs for axis, limit in zip(config.axes, config.limits, strict=True)
        }
        if isinstance(options, ServoOptions):
            bench = self.benches[name] = Bench(name, options, bus.axes)
            for servo, axis in zip(bench.emulator.servos, bus.axes, strict=True):
                assert axis.travel is not None
                low, high = sorted(end / reg.RAD_PER_TICK for end in axis.travel)
                self.servos.append(ServoEyes(servo, axis.name, low, high))
            self._stack.enter_context(bench)
            return
        assert isinstance(options, DueOptions)
        board = self.boards[name] = self._stack.enter_context(Board(options, bus.axes))
        for axis in bus.axes:
            wired, travel = axis_options(axis), axis.travel
            assert travel is not None
            motor = wired.kind is DeviceKind.MOTOR
            if motor:
                per_rad = wired.counts_per_rev / 6.283185307179586
                low, high = sorted(end * per_rad for end in travel)
                speed = limits[axis.name].step * RATE_HZ * scales[axis.name] * per_rad
                # The plant is a motor with inertia under a position loop, not the command itself.
                room = 0.02 * (high - low)
                eyes = ChannelEyes(board, axis.name, wired.number, True, low - room, high + room, 1.5 * speed)
            else:
                assert wired.ceiling_bar is not None
                eyes = ChannelEyes(board, axis.name, wired.number, False, -2e3, wired.ceiling_bar * 1e5, 0.0)
            self.channels.append(eyes)

    def _watch(self) -> None:
        while not self._ended.wait(LOOK_S):
            for eyes in self.channels:
                eyes.look()

    # -- faults --------------------------------------------------------------------------------------------

    def switches(self, bus: str) -> Sequence[Switch]:
        if bus in self.benches:
            return SERVO_SWITCHES
        motor = any(eyes.motor for eyes in self.channels if eyes.board is self.boards[bus])
        return MOTOR_SWITCHES if motor else REGULATOR_SWITCHES

    def throw(self, bus: str, switch: Switch, axis: int, dice: random.Random) -> None:
        """Switch a fault on."""
        if bus in self.benches:
            emulator = self.benches[bus].emulator
            device = emulator.servos[axis].device if switch.on_axis else None
            more: dict[str, Any] = {"count": dice.randint(1, 6)} if switch.name in _COUNTED else {}
            more |= {"ms": dice.choice((2.0, 8.0))} if switch.name == "delay" else {}
            more |= dice.choice(ADAPTER.get(switch.name, ({},)))
            emulator.set(switch.name, device, **more)
            return
        channel = {"channel": self._numbers(bus)[axis]} if switch.on_axis else {}
        more = {"ms": 600} if switch.name == "freeze" else {}
        self.boards[bus].fault(switch.name, **channel, **more)

    def heal(self) -> None:
        """Every switch off; what devices latched stays latched."""
        for bench in self.benches.values():
            emulator = bench.emulator
            for servo in emulator.servos:
                emulator.set("silent", servo.device, on=False)
                emulator.set("delay", servo.device, ms=0.0)
                emulator.set("jam", servo.device, on=False)
                emulator.set("freeze", servo.device, on=False)
                for name in _COUNTED:
                    emulator.set(name, servo.device, count=0)
            emulator.set("echo", on=False)
            for name in ADAPTER:
                emulator.set(name, count=0)
            if not Path(emulator.port).is_symlink():
                emulator.set("replug")
        for bus, board in self.boards.items():
            for switch in self.switches(bus):
                if switch.on_axis:
                    for number in self._numbers(bus):
                        board.fault(switch.name, channel=number, on=False)
                elif switch.name in ("mute", "garbage"):
                    board.fault(switch.name, on=False)
            board.fault("plug")

    def _numbers(self, bus: str) -> list[int]:
        return [eyes.number for eyes in self.channels if eyes.board is self.boards[bus]]

    # -- eyes ----------------------------------------------------------------------------------------------

    def driven(self) -> list[str]:
        """Servos and motors under power, and chambers under pressure."""
        servos = [eyes.axis for eyes in self.servos if eyes.powered]
        motors = [eyes.axis for eyes in self.channels if eyes.motor and eyes.powered]
        return [*servos, *motors, *(e.axis for e in self.channels if not e.motor and e.value > EMPTY_PA)]

    def resting_s(self, since_s: float) -> float:
        """How long after an order the last output went off, or the last chamber began to empty [s]."""
        offs = [eyes.torque_off_s for eyes in self.servos]
        for eyes in self.channels:
            offs.append(eyes.off_s if eyes.motor else _falls_s(tuple(eyes.seen), since_s))
        return max((at for at in offs if at > since_s), default=since_s) - since_s


def _falls_s(seen: Sequence[tuple[float, float]], since_s: float) -> float:
    """When a pressure first was lower than when the order came."""
    before = max((value for at, value in seen if at <= since_s), default=0.0)
    top = before
    for at, value in seen:
        if at > since_s and top > EMPTY_PA:
            if value < top - FALLEN_PA:
                return at
            top = max(top, value)
    return 0.0


_COUNTED: Final = ("drop", "corrupt", "duplicate")


def _scale(config: Any, index: int) -> float:
    """Device units per unit of actuation of an axis, at its greatest."""
    low = tuple(limit.lower for limit in config.limits)
    near = tuple(
        value + (1e-4 * (limit.upper - limit.lower) if place == index else 0.0)
        for place, (value, limit) in enumerate(zip(low, config.limits, strict=True))
    )
    device = [config.transmission.to_device(values)[index] for values in (low, near)]
    return float(abs(device[1] - device[0]) / (near[index] - low[index]))
