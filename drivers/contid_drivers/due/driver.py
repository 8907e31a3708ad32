"""The entry point: options and factories; everything that touches a port is imported when it is needed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from contid.errors import DeviceNotFoundError
from contid.hal import AxisOnBus, Bus, Clock, DeviceKind, Driver
from contid_drivers.due.options import AxisOptions, BusOptions

if TYPE_CHECKING:
    from pydantic import BaseModel


class DueDriver:
    """See `contid.hal.Driver`."""

    bus_options: type[BaseModel] = BusOptions
    axis_options: type[BaseModel] = AxisOptions

    def kind(self, axis: BaseModel) -> DeviceKind:
        """Motors (rad of the output shaft) on channels ``m``, regulators (Pa) on channels ``p``."""
        assert isinstance(axis, AxisOptions)
        return axis.kind

    def address(self, axis: BaseModel) -> str:
        """The channel of the board."""
        assert isinstance(axis, AxisOptions)
        return f"channel {axis.channel}"

    def mock_options(self, bus: BaseModel) -> Mapping[str, Any]:
        """The simulated twin needs nothing of this bus's wire."""
        return {}

    def mock_axis_options(self, axis: BaseModel) -> Mapping[str, Any]:
        """The simulated twin of a channel."""
        assert isinstance(axis, AxisOptions)
        return {"device": axis.kind.value}

    def open_bus(self, name: str, options: BaseModel, axes: Sequence[AxisOnBus], clock: Clock) -> Bus:
        """Build the bus; touches no device."""
        raise DeviceNotFoundError(name, "the Due bus is not built yet", "use --mock")


DRIVER: Driver = DueDriver()
