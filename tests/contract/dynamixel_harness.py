"""The Dynamixel driver under the contract: emulated servos on a pty, in real time.

They answer as soon as they are asked, without the time of the bytes: hundreds of registers are set to enable
them, each within a fixed time, and each pause of the emulator ends late where other tests run.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from contid.hal import AxisOnBus, DeviceKind, Rest
from contid_driverkit.clock import MonotonicClock
from contid_driverkit.contract import Facts, RealTimeRig
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.bus import DynamixelBus
from contid_drivers.dynamixel.options import DynamixelAxisOptions, DynamixelBusOptions
from contid_emulate.dynamixel import DynamixelEmulator, Servo

AXES = ("left.a", "left.b", "right.a")
STEP = reg.RAD_PER_TICK
OVERLOAD = 0x20


class DynamixelRig(RealTimeRig):
    """A `contid_driverkit.contract.BusUnderTest` of emulated servos."""

    def __init__(self, port: Path) -> None:
        self.facts = Facts(DeviceKind.SERVO, STEP, 3 * STEP, 0.5, 30.0, 0.3, 0.2, 0.0, Rest.HOLD)
        self.emulator = DynamixelEmulator(
            [Servo(i + 1, position_ticks=1000.0 * (i + 1)) for i in range(len(AXES))], port, paced=False
        )
        self._ids = {axis: i + 1 for i, axis in enumerate(AXES)}
        axes = [AxisOnBus(axis, DynamixelAxisOptions(id=device)) for axis, device in self._ids.items()]
        options = DynamixelBusOptions(port=str(port), watchdog_ms=200, usb_latency_ms=30.0, retry_ms=50.0)
        self.bus = DynamixelBus("servos", options, axes, MonotonicClock())

    def value(self, axis: str) -> float:
        return self._servo(axis).position_ticks * STEP

    def powered(self, axis: str) -> bool:
        return self._servo(axis).torque

    def silence(self, axis: str, silent: bool) -> None:
        self.emulator.set("silent", self._ids[axis], on=silent)

    def unplug(self) -> None:
        self.emulator.set("unplug")

    def plug(self) -> None:
        self.emulator.set("replug")

    def break_device(self, axis: str) -> None:
        servo, reboot = self._servo(axis), self._servo(axis).reboot

        def reboot_in_vain() -> None:
            reboot()
            servo.fail(OVERLOAD)

        servo.reboot = reboot_in_vain  # type: ignore[method-assign]
        self.emulator.set("overload", self._ids[axis])

    def repair_device(self, axis: str) -> None:
        del self._servo(axis).reboot  # that of the class again

    def _servo(self, axis: str) -> Servo:
        return self.emulator.servo(self._ids[axis])


@contextmanager
def servo() -> Iterator[DynamixelRig]:
    with tempfile.TemporaryDirectory() as folder:
        rig = DynamixelRig(Path(folder) / "servos.pty")
        with rig.emulator:
            yield rig
            rig.bus.close()
