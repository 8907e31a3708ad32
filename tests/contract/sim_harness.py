"""Simulated buses under the contract, in virtual time."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from contid.control.engine.cycle import VirtualClock
from contid.hal import AxisOnBus, DeviceKind, Rest, Sample, load_driver
from contid_driverkit.contract import TICK_S, Facts
from contid_drivers.sim.bus import SimBus
from contid_drivers.sim.options import FaultKind, SimAxisOptions, SimBusOptions
from tests.support.sim_faults import advance, heal, inject

AXES = ("left.a", "left.b", "right.a")


class SimRig:
    """A `contid_driverkit.contract.BusUnderTest` of simulated devices."""

    def __init__(self, options: SimAxisOptions, facts: Facts) -> None:
        self.facts = facts
        self.clock = VirtualClock(100.0)
        axes = [AxisOnBus(name, options) for name in AXES]
        bus_options = SimBusOptions(seed=1, watchdog_ms=facts.silence_s * 1e3)
        bus = load_driver("sim").open_bus("bus", bus_options, axes, self.clock)
        assert isinstance(bus, SimBus)
        self.bus = bus

    def pump(self, seconds: float, commands: Mapping[str, float] | None = None) -> Mapping[str, Sample]:
        for _ in range(max(1, math.ceil(seconds / TICK_S))):
            self.clock.sleep(TICK_S)
            samples = self.bus.exchange(commands or {})
        return samples

    def wait(self, seconds: float) -> None:
        self.clock.sleep(seconds)

    def value(self, axis: str) -> float:
        return float(self._device(axis).motion.value)

    def powered(self, axis: str) -> bool:
        device = self._device(axis)
        return device.on or device.rest is Rest.HOLD

    def silence(self, axis: str, silent: bool) -> None:
        (inject if silent else heal)(self.bus, FaultKind.SILENT, axis)

    def unplug(self) -> None:
        inject(self.bus, FaultKind.LOST)

    def plug(self) -> None:
        heal(self.bus, FaultKind.LOST)

    def break_device(self, axis: str) -> None:
        inject(self.bus, FaultKind.OVERLOAD, axis)

    def repair_device(self, axis: str) -> None:
        heal(self.bus, FaultKind.OVERLOAD, axis)

    def _device(self, axis):
        advance(self.bus)
        return self.bus.devices[axis]


@contextmanager
def servo() -> Iterator[SimRig]:
    tick = 2.0 * math.pi / 4096.0
    yield SimRig(
        SimAxisOptions(device=DeviceKind.SERVO, start_deg=400.0),
        Facts(DeviceKind.SERVO, tick, 3 * tick, 0.5, 30.0, 0.5, 0.2, 0.0, Rest.HOLD),
    )


@contextmanager
def motor() -> Iterator[SimRig]:
    count = 2.0 * math.pi / 4776.0
    yield SimRig(
        SimAxisOptions(device=DeviceKind.MOTOR),
        Facts(DeviceKind.MOTOR, count, 2 * count, 0.5, 30.0, 0.6, 0.2, 0.0, Rest.HOLD),
    )


@contextmanager
def regulator() -> Iterator[SimRig]:
    yield SimRig(
        SimAxisOptions(device=DeviceKind.REGULATOR, start_bar=0.5, slew_bar_s=1.0, ceiling_bar=3.0),
        Facts(DeviceKind.REGULATOR, 80.0, 2000.0, 0.3e5, 2.4e5, 0.8, 0.2, 1.2, Rest.VENT),
    )
