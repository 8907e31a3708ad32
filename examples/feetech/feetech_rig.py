"""Emulated Feetech servos as a bus under test of `contid_driverkit.contract`, in real time."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

from contid.hal import AxisOnBus, DeviceKind
from contid_driverkit import MonotonicClock
from contid_driverkit.contract import Facts, RealTimeRig
from contid_feetech import FeetechAxisOptions, FeetechOptions
from contid_feetech.bus import STEPS_PER_RAD, FeetechBus
from contid_feetech.emulator import FeetechEmulator, Servo

IDS = {"left.a": 1, "left.b": 7, "right.a": 252}


def bus_at(port: Path, series: str, axes: Sequence[AxisOnBus], **keys: object) -> FeetechBus:
    given = {"port": str(port), "series": series, "latency_ms": 60.0, **keys}
    return FeetechBus("servos", FeetechOptions.model_validate(given), axes, MonotonicClock())


class FeetechRig(RealTimeRig):
    """A `contid_driverkit.contract.BusUnderTest` of emulated servos."""

    bus: FeetechBus

    def __init__(self, port: Path, series: str, *, echo: bool = False) -> None:
        step = 1.0 / STEPS_PER_RAD[series]
        self.step = step
        self.facts = Facts(DeviceKind.SERVO, step, 2 * step, 0.2, 3.0, 0.35, watchdog_s=None)
        start = 500.0 if series == "sts" else 100.0
        self.emulator = FeetechEmulator(
            str(port), [Servo(each, series, start) for each in IDS.values()], echo=echo
        )
        axes = [AxisOnBus(axis, FeetechAxisOptions(id=each, speed_deg_s=60.0)) for axis, each in IDS.items()]
        self.bus = bus_at(port, series, axes, echo=echo)

    def value(self, axis: str) -> float:
        with self.emulator.lock:
            self.emulator.advance()
            return self.emulator.servos[IDS[axis]].position * self.step

    def powered(self, axis: str) -> bool:
        with self.emulator.lock:
            self.emulator.advance()
            return self.emulator.servos[IDS[axis]].memory[40] == 1

    def silence(self, axis: str, silent: bool) -> None:
        self.emulator.switch({"fault": "silent", "id": IDS[axis], "on": silent})

    def unplug(self) -> None:
        self.emulator.switch({"fault": "unplug"})

    def plug(self) -> None:
        self.emulator.switch({"fault": "unplug", "on": False})

    def break_device(self, axis: str) -> None:
        self.emulator.switch({"fault": "overload", "id": IDS[axis]})

    def repair_device(self, axis: str) -> None:
        self.emulator.switch({"fault": "overload", "id": IDS[axis], "on": False})


@contextmanager
def feetech(series: str = "sts", *, echo: bool = False) -> Iterator[FeetechRig]:
    with tempfile.TemporaryDirectory() as folder:
        rig = FeetechRig(Path(folder) / "servos", series, echo=echo)
        with rig.emulator:
            yield rig


def sts() -> AbstractContextManager[FeetechRig]:
    return feetech("sts")


def scs() -> AbstractContextManager[FeetechRig]:
    return feetech("scs")


def echo() -> AbstractContextManager[FeetechRig]:
    return feetech("sts", echo=True)
