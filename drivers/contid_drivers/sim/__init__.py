"""Simulated buses: servo, geared motor and pressure regulator on a given clock."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

from contid_drivers.sim.options import SimAxisOptions, SimBusOptions

if TYPE_CHECKING:
    from pydantic import BaseModel

    from contid.hal import AxisOnBus, Bus, Clock, DeviceKind, DeviceResponse


class SimDriver:
    """The `contid.hal.Driver` of simulated buses."""

    bus_options: type[BaseModel] = SimBusOptions
    axis_options: type[BaseModel] = SimAxisOptions

    def kind(self, axis: BaseModel) -> DeviceKind:
        """The device the axis simulates."""
        assert isinstance(axis, SimAxisOptions)
        return axis.device

    def address(self, axis: BaseModel) -> str:
        """Simulated axes have names only."""
        return ""

    def device_response(self, bus: BaseModel, axis: BaseModel) -> DeviceResponse:
        """Of a simulated device: a file that makes it slow means that (`contid.hal.Responds`)."""
        from contid_drivers.sim.devices import simulated_response

        assert isinstance(axis, SimAxisOptions)
        return simulated_response(axis)

    def mock_options(self, bus: BaseModel) -> Mapping[str, Any]:
        """See `contid.hal.Driver`; a simulated bus replaces itself."""
        return bus.model_dump(exclude_unset=True)

    def mock_axis_options(self, axis: BaseModel) -> Mapping[str, Any]:
        """Options of the ``sim`` axis that replaces this axis, at least ``{"device": KIND}``.

        See `contid.hal.Driver`; a simulated axis replaces itself.
        """
        return axis.model_dump(exclude_unset=True)

    def open_bus(self, name: str, options: BaseModel, axes: Sequence[AxisOnBus], clock: Clock) -> Bus:
        """Build the bus with its devices at rest at their start values."""
        from contid_drivers.sim.bus import SimBus

        assert isinstance(options, SimBusOptions)
        return SimBus(name, options, axes, clock)


DRIVER: Final = SimDriver()
