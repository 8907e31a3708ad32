"""The entry point: options and factories; everything that touches a port is imported when it is needed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from contid.hal import AxisOnBus, Bus, Clock, DeviceKind, Driver
from contid_drivers.dynamixel.options import AxisOptions, BusOptions

if TYPE_CHECKING:
    from pydantic import BaseModel


class DynamixelDriver:
    """See `contid.hal.Driver`."""

    bus_options: type[BaseModel] = BusOptions
    axis_options: type[BaseModel] = AxisOptions

    def kind(self, axis: BaseModel) -> DeviceKind:
        """Every axis is a servo: rad at the boundary."""
        return DeviceKind.SERVO

    def address(self, axis: BaseModel) -> str:
        """The servo's id."""
        assert isinstance(axis, AxisOptions)
        return f"id {axis.id}"

    def mock_options(self, bus: BaseModel) -> Mapping[str, Any]:
        """The simulated twin needs nothing of this bus's wire."""
        return {}

    def mock_axis_options(self, axis: BaseModel) -> Mapping[str, Any]:
        """A simulated servo."""
        return {"device": DeviceKind.SERVO.value}

    def open_bus(self, name: str, options: BaseModel, axes: Sequence[AxisOnBus], clock: Clock) -> Bus:
        """Build the bus; touches no device."""
        from contid_drivers.dynamixel.bus import DynamixelBus

        assert isinstance(options, BusOptions)
        return DynamixelBus(name, options, axes, clock)

    def emulator(
        self, name: str, options: BaseModel, axes: Sequence[AxisOnBus], control: Path | None = None
    ) -> AbstractContextManager[Sequence[str]]:
        """See `contid.hal.Emulates`."""
        from contid_drivers.dynamixel.emulator.bench import Bench

        assert isinstance(options, BusOptions)
        return Bench(name, options, axes, control)


DRIVER: Driver = DynamixelDriver()
