"""The laboratory on wires: emulated servos, the Due's firmware on ptys, fault switches and probes.

Hand (Dynamixel), tri-rack (Due, motors) and CBHA (two Due boards, pressures) in one robot file, or hand and
tendon robot (nine servos). What the devices received and did is checked on their side of the wire, not on
the driver's.
"""

from __future__ import annotations

import math
import os
import random
import threading
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

from contid.control.engine.wiring import WiredBus, build_robot_configs, wired_buses
from contid.control.tick.config import RobotConfig
from contid.hal import DeviceKind
from contid.robot_file.load import LoadedFile, load_robot_file
from contid_drivers.due.options import DueBusOptions as DueOptions
from contid_drivers.due.wiring import axis_options
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.options import DynamixelBusOptions as ServoOptions
from contid_emulate.due import DueEmulator as Board
from contid_emulate.dynamixel.bench import Bench
from tests.campaign.wired.lab_file import RATE_HZ
from tests.campaign.wired.probes import EMPTY_PA, ChannelProbe, ServoProbe, falls_s
from tests.campaign.wired.switches import (
    ADAPTER,
    COUNTED,
    MOTOR_SWITCHES,
    REGULATOR_SWITCHES,
    SERVO_SWITCHES,
    Switch,
)

#: Of SCHED_FIFO, below the control process, as `contid emulate` has it.
PRIORITY: Final = 40
#: How often the boards are looked at.
LOOK_S: Final = 0.02


class Wires:
    """Context manager: every bus of the file is alive while it lasts."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.loaded: LoadedFile = load_robot_file(path)
        self.buses: dict[str, WiredBus] = {bus.wiring.name: bus for bus in wired_buses(self.loaded)}
        self.benches: dict[str, Bench] = {}
        self.boards: dict[str, Board] = {}
        self.servos: list[ServoProbe] = []
        self.channels: list[ChannelProbe] = []
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
            watcher = threading.Thread(target=self._watch, name="probe on boards")
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
                self.servos.append(ServoProbe(servo, axis.name, low, high))
            self._stack.enter_context(bench)
            return
        assert isinstance(options, DueOptions)
        board = self.boards[name] = self._stack.enter_context(Board(options, bus.axes))
        for axis in bus.axes:
            wired, travel = axis_options(axis), axis.travel
            assert travel is not None
            motor = wired.kind is DeviceKind.MOTOR
            if motor:
                per_rad = wired.counts_per_rev / math.tau
                low, high = sorted(end * per_rad for end in travel)
                speed = limits[axis.name].step * RATE_HZ * scales[axis.name] * per_rad
                # The plant is a motor with inertia under a position loop, not the command itself.
                room = 0.02 * (high - low)
                probe = ChannelProbe(
                    board, axis.name, wired.number, True, low - room, high + room, 1.5 * speed
                )
            else:
                assert wired.ceiling_bar is not None
                probe = ChannelProbe(
                    board, axis.name, wired.number, False, -2e3, wired.ceiling_bar * 1e5, 0.0
                )
            self.channels.append(probe)

    def _watch(self) -> None:
        while not self._ended.wait(LOOK_S):
            for probe in self.channels:
                probe.look()

    # -- faults --------------------------------------------------------------------------------------------

    def switches(self, bus: str) -> Sequence[Switch]:
        if bus in self.benches:
            return SERVO_SWITCHES
        motor = any(probe.motor for probe in self.channels if probe.board is self.boards[bus])
        return MOTOR_SWITCHES if motor else REGULATOR_SWITCHES

    def throw(self, bus: str, switch: Switch, axis: int, dice: random.Random) -> None:
        """Switch a fault on."""
        if bus in self.benches:
            emulator = self.benches[bus].emulator
            device = emulator.servos[axis].device if switch.on_axis else None
            more: dict[str, Any] = {"count": dice.randint(1, 6)} if switch.name in COUNTED else {}
            more |= {"ms": dice.choice((2.0, 8.0))} if switch.name == "delay" else {}
            more |= dice.choice(ADAPTER.get(switch.name, ({},)))
            emulator.set(switch.name, device, **more)
            return
        channel = {"channel": self._numbers(bus)[axis]} if switch.on_axis else {}
        more = {"ms": 600} if switch.name == "freeze" else {}
        self.boards[bus].switch({"fault": switch.name, **channel, **more})

    def heal(self) -> None:
        """Every switch off; what devices latched stays latched."""
        for bench in self.benches.values():
            emulator = bench.emulator
            for servo in emulator.servos:
                emulator.set("silent", servo.device, on=False)
                emulator.set("delay", servo.device, ms=0.0)
                emulator.set("jam", servo.device, on=False)
                emulator.set("freeze", servo.device, on=False)
                for name in COUNTED:
                    emulator.set(name, servo.device, count=0)
            emulator.set("echo", on=False)
            for name, settings in ADAPTER.items():
                emulator.set(name, **dict.fromkeys(settings[0], 0))
            if not Path(emulator.port).is_symlink():
                emulator.set("replug")
        for bus, board in self.boards.items():
            for switch in self.switches(bus):
                if switch.on_axis:
                    for number in self._numbers(bus):
                        board.switch({"fault": switch.name, "channel": number, "on": False})
                elif switch.name in ("mute", "garbage"):
                    board.switch({"fault": switch.name, "on": False})
            board.switch({"fault": "plug"})

    def _numbers(self, bus: str) -> list[int]:
        return [probe.number for probe in self.channels if probe.board is self.boards[bus]]

    # -- probe ----------------------------------------------------------------------------------------------

    def driven(self) -> list[str]:
        """Servos and motors under power, and chambers under pressure."""
        servos = [probe.axis for probe in self.servos if probe.powered]
        motors = [probe.axis for probe in self.channels if probe.motor and probe.powered]
        return [*servos, *motors, *(e.axis for e in self.channels if not e.motor and e.value > EMPTY_PA)]

    def resting_s(self, since_s: float) -> float:
        """How long after an order the last output went off, or the last chamber began to empty [s]."""
        offs = [probe.torque_off_s for probe in self.servos]
        for probe in self.channels:
            offs.append(probe.off_s if probe.motor else falls_s(tuple(probe.seen), since_s))
        return max((at for at in offs if at > since_s), default=since_s) - since_s


def _scale(config: RobotConfig, index: int) -> float:
    """Device units per unit of actuation of an axis, at its greatest."""
    low = tuple(limit.lower for limit in config.limits)
    near = tuple(
        value + (1e-4 * (limit.upper - limit.lower) if place == index else 0.0)
        for place, (value, limit) in enumerate(zip(low, config.limits, strict=True))
    )
    device = [config.transmission.to_device(values)[index] for values in (low, near)]
    return float(abs(device[1] - device[0]) / (near[index] - low[index]))
