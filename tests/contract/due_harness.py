"""The Due driver under the contract: the firmware itself on a pty with its plant, in real time."""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from contid.hal import AxisOnBus, DeviceKind, Rest
from contid_driverkit.clock import MonotonicClock
from contid_driverkit.contract import Facts, RealTimeRig
from contid_drivers.due.bus import DueBus
from contid_drivers.due.options import DueAxisOptions, DueBusOptions, Role
from contid_emulate.due import DueEmulator

#: Of boards and hosts that share the machine with other tests.
WATCHDOG_S = 0.3
COUNT = math.tau / 4776.0
MOTORS = Facts(DeviceKind.MOTOR, 2 * COUNT, 12 * COUNT, 0.2, 60.0, 0.45, WATCHDOG_S, 0.0, Rest.RELAX)
# 3 bar on 12 bit are 75 Pa a step.
REGULATORS = Facts(DeviceKind.REGULATOR, 300.0, 1500.0, 15_000.0, 150_000.0, 0.4, WATCHDOG_S, 0.3, Rest.VENT)
REGULATOR = {
    "calibration": [[0, 0], [100, 3]],
    "readback": [[600, 0], [3000, 3]],
    "wire_break_mv": 540,
    "ceiling_bar": 2.0,
    "slew_bar_s": 1.0,
    "vent_bar_s": 4.0,
}


class DueRig(RealTimeRig):
    """A `contid_driverkit.contract.BusUnderTest` of one emulated board."""

    def __init__(self, port: Path, facts: Facts, letter: str, axis_keys: Mapping[str, Any]) -> None:
        self.facts = facts
        self.port = port
        self._channels = {"left.a": 0, "left.b": 3, "right.a": 5}
        axes = [
            AxisOnBus(axis, DueAxisOptions.model_validate({"channel": f"{letter}{number}", **axis_keys}))
            for axis, number in self._channels.items()
        ]
        role = Role.MOTOR if letter == "m" else Role.PRESSURE
        options = DueBusOptions(
            port=str(port), role=role, watchdog_ms=round(1e3 * WATCHDOG_S), latency_ms=60.0
        )
        self.emulator = DueEmulator(options, axes)
        self.bus = DueBus("board", options, axes, MonotonicClock())

    def _truth(self, axis: str) -> list[float]:
        """Of a tick that began after the question: what the board was asked has reached its outputs."""
        asked = self._get(axis)
        while (now := self._get(axis))[-1] < asked[-1] + 2:
            time.sleep(0.0005)
        return now

    def _get(self, axis: str) -> list[float]:
        return [float(number) for number in self.emulator.command(f"get {self._channels[axis]}").split()]

    def value(self, axis: str) -> float:
        truth = self._truth(axis)
        return truth[0] * COUNT if self.facts.kind is DeviceKind.MOTOR else truth[2]

    def powered(self, axis: str) -> bool:
        return self._truth(axis)[4] == 2  # the output drives

    def silence(self, axis: str, silent: bool) -> None:
        self.emulator.switch({"fault": "silent", "channel": self._channels[axis], "on": silent})

    def unplug(self) -> None:
        self.emulator.switch({"fault": "unplug"})
        while self.port.is_symlink():
            time.sleep(0.001)

    def plug(self) -> None:
        self.emulator.switch({"fault": "plug"})
        while not self.port.exists():
            time.sleep(0.001)

    def break_device(self, axis: str) -> None:
        self._fault(axis, True)

    def repair_device(self, axis: str) -> None:
        self._fault(axis, False)

    def _fault(self, axis: str, on: bool) -> None:
        name = "bridge" if self.facts.kind is DeviceKind.MOTOR else "wire"
        self.emulator.switch({"fault": name, "channel": self._channels[axis], "on": on})


@contextmanager
def _rig(facts: Facts, letter: str, axis_keys: Mapping[str, Any]) -> Iterator[DueRig]:
    with tempfile.TemporaryDirectory() as folder:
        rig = DueRig(Path(folder) / "board.pty", facts, letter, axis_keys)
        with rig.emulator:
            yield rig
            rig.bus.close()


@contextmanager
def motors() -> Iterator[DueRig]:
    with _rig(MOTORS, "m", {}) as rig:
        yield rig


@contextmanager
def regulators() -> Iterator[DueRig]:
    with _rig(REGULATORS, "p", REGULATOR) as rig:
        yield rig
