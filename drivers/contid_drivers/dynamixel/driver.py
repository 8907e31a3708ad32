"""The entry point of driver ``dynamixel``; modules that touch a port are imported on use."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from contid.hal import (
    RESPONSES,
    AxisOnBus,
    Bus,
    Clock,
    DeviceKind,
    DeviceRate,
    DeviceResponse,
    Driver,
    ExchangeTime,
)
from contid.hal.pulses import ProvenDevice
from contid.units import DEG
from contid_drivers.dynamixel.options import DynamixelAxisOptions, DynamixelBusOptions

if TYPE_CHECKING:
    from pydantic import BaseModel


class DynamixelDriver:
    """The driver of Dynamixel servos (`contid.hal.Driver`)."""

    bus_options: type[BaseModel] = DynamixelBusOptions
    axis_options: type[BaseModel] = DynamixelAxisOptions

    def kind(self, axis: BaseModel) -> DeviceKind:
        """Every axis is a servo; its values are angles [rad]."""
        return DeviceKind.SERVO

    def address(self, axis: BaseModel) -> str:
        """The servo's id."""
        assert isinstance(axis, DynamixelAxisOptions)
        return f"id {axis.id}"

    def device_response(self, bus: BaseModel, axis: BaseModel) -> DeviceResponse:
        """Of a servo; with limited current it yields to what it pushes on (`contid.hal.Responds`).

        The limit that a servo keeps itself is read from it later, and may be less than that of its model.
        """
        assert isinstance(bus, DynamixelBusOptions)
        assert isinstance(axis, DynamixelAxisOptions)
        if (axis.mode or bus.mode) != "current_based_position":
            return RESPONSES[DeviceKind.SERVO]
        limits_ma = [each for each in (axis.current_limit_ma, axis.goal_current_ma) if each]
        return replace(RESPONSES[DeviceKind.SERVO], effort_limit_a=min(limits_ma, default=0.0) / 1e3)

    def device_rate(self, axis: BaseModel) -> DeviceRate:
        """Its own speed without load, or the profile that is written into it (`contid.hal.LimitsRate`)."""
        from contid_drivers.dynamixel.models import NO_LOAD_RPM
        from contid_drivers.dynamixel.registers import RAD_PER_TICK, TURNS

        assert isinstance(axis, DynamixelAxisOptions)
        top = NO_LOAD_RPM.get(axis.model, math.inf) * math.tau / 60.0
        rates = [DeviceRate("model", top, f"without load a {axis.model} does")]
        if axis.profile_velocity_deg_s:
            rates.append(DeviceRate("profile_velocity_deg_s", axis.profile_velocity_deg_s * DEG))
        slowest = min(rates, key=lambda rate: rate.value)
        return replace(slowest, reach=TURNS * RAD_PER_TICK, step=RAD_PER_TICK)

    def mock_options(self, bus: BaseModel) -> Mapping[str, Any]:
        """See `contid.hal.Driver`: none, a simulated bus needs no key of this one."""
        return {}

    def mock_axis_options(self, axis: BaseModel) -> Mapping[str, Any]:
        """See `contid.hal.Driver`: a simulated servo."""
        return {"device": DeviceKind.SERVO.value}

    def open_bus(self, name: str, options: BaseModel, axes: Sequence[AxisOnBus], clock: Clock) -> Bus:
        """Build the bus; touches no device."""
        from contid_drivers.dynamixel.bus import DynamixelBus

        assert isinstance(options, DynamixelBusOptions)
        return DynamixelBus(name, options, axes, clock)

    def exchange_time(self, options: BaseModel, axes: Sequence[BaseModel]) -> ExchangeTime:
        """Time of one exchange with every axis of a bus (`contid.hal.Paces`)."""
        from contid_drivers.dynamixel.cycle_time import exchange_time

        assert isinstance(options, DynamixelBusOptions)
        return exchange_time(options, [axis for axis in axes if isinstance(axis, DynamixelAxisOptions)])

    def wiring(self, options: BaseModel, axis: BaseModel) -> Mapping[str, object]:
        """The options that a change of wiring would change (`contid.hal.pulses.Proves`)."""
        from contid_drivers.dynamixel.checks.identity import wiring

        assert isinstance(options, DynamixelBusOptions)
        assert isinstance(axis, DynamixelAxisOptions)
        return wiring(options, axis)

    def devices(self, name: str, options: BaseModel, axes: Sequence[AxisOnBus]) -> Mapping[str, ProvenDevice]:
        """The servo of each axis that answers (`contid.hal.pulses.Proves`)."""
        from contid_drivers.dynamixel.checks.identity import devices

        assert isinstance(options, DynamixelBusOptions)
        return devices(name, options, axes)


DRIVER: Driver = DynamixelDriver()
