"""The entry point of driver ``due``; modules that touch a port are imported on use."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
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
    RefusedKey,
)
from contid.hal.pulses import ProvenDevice
from contid.units import BAR, DEG
from contid_drivers.due.options import DueAxisOptions, DueBusOptions, SafeState

if TYPE_CHECKING:
    from pydantic import BaseModel


class DueDriver:
    """The driver of Due boards, motors and pressure regulators (`contid.hal.Driver`)."""

    bus_options: type[BaseModel] = DueBusOptions
    axis_options: type[BaseModel] = DueAxisOptions

    def kind(self, axis: BaseModel) -> DeviceKind:
        """Motors (rad of the output shaft) on channels ``m``, regulators (Pa) on channels ``p``."""
        assert isinstance(axis, DueAxisOptions)
        return axis.kind

    def address(self, axis: BaseModel) -> str:
        """The channel of the board."""
        assert isinstance(axis, DueAxisOptions)
        return f"channel {axis.channel}"

    def mock_options(self, bus: BaseModel) -> Mapping[str, Any]:
        """See `contid.hal.Driver`; the simulated bus has the same watchdog."""
        assert isinstance(bus, DueBusOptions)
        return {"watchdog_ms": max(bus.watchdog_ms, 10)}

    def mock_axis_options(self, axis: BaseModel) -> Mapping[str, Any]:
        """Options of the ``sim`` axis that replaces this axis, at least ``{"device": KIND}``.

        See `contid.hal.Driver`; limits and safe state are kept.
        """
        assert isinstance(axis, DueAxisOptions)
        if axis.kind is DeviceKind.MOTOR:
            return {
                "device": axis.kind.value,
                "on_watchdog": "hold" if axis.safe is SafeState.HOLD else "relax",
                "start_deg": axis.power_up_deg,
                "velocity_deg_s": axis.velocity_deg_s,
                "acceleration_deg_s2": axis.acceleration_deg_s2,
            }
        return {
            "device": axis.kind.value,
            "on_watchdog": "relax" if axis.safe is SafeState.CLOSE else "vent",
            "slew_bar_s": axis.slew_bar_s,
            "vent_bar_s": axis.vent_bar_s,
            "ceiling_bar": axis.ceiling_bar,
        }

    def device_response(self, bus: BaseModel, axis: BaseModel) -> DeviceResponse:
        """Of the device of an axis: the board ramps set-points of regulators (`contid.hal.Responds`)."""
        assert isinstance(axis, DueAxisOptions)
        response = RESPONSES[axis.kind]
        return response if axis.kind is DeviceKind.MOTOR else replace(response, top=axis.slew_bar_s * BAR)

    def device_rate(self, axis: BaseModel) -> DeviceRate:
        """See `contid.hal.LimitsRate`: the board's set-point is no faster."""
        assert isinstance(axis, DueAxisOptions)
        if axis.kind is DeviceKind.MOTOR:
            return DeviceRate(
                "velocity_deg_s",
                axis.velocity_deg_s * DEG,
                acceleration=axis.acceleration_deg_s2 * DEG,
                acceleration_key="acceleration_deg_s2",
                step=math.tau / axis.counts_per_rev,
            )
        return DeviceRate("slew_bar_s", axis.slew_bar_s * BAR)

    def refused(self, options: BaseModel, axes: Sequence[tuple[str, BaseModel]]) -> Iterator[RefusedKey]:
        """See `contid.hal.Restricts`: every open of the programming port resets the board and its counts."""
        assert isinstance(options, DueBusOptions)
        lost = [name for name, axis in axes if isinstance(axis, DueAxisOptions) and axis.parkable]
        if options.connection == "programming" and lost:
            yield RefusedKey(
                "connection",
                f"programming resets the board at every open, and {', '.join(lost)} would lose the position; "
                "allowed: native, or homing at each of these axes",
            )

    def open_bus(self, name: str, options: BaseModel, axes: Sequence[AxisOnBus], clock: Clock) -> Bus:
        """Build the bus; touches no device."""
        from contid_drivers.due.bus import DueBus

        assert isinstance(options, DueBusOptions)
        return DueBus(name, options, axes, clock)

    def wiring(self, options: BaseModel, axis: BaseModel) -> Mapping[str, object]:
        """The options that a change of wiring would change (`contid.hal.pulses.Proves`)."""
        from contid_drivers.due.identity import wiring

        assert isinstance(options, DueBusOptions)
        assert isinstance(axis, DueAxisOptions)
        return wiring(options, axis)

    def devices(self, name: str, options: BaseModel, axes: Sequence[AxisOnBus]) -> Mapping[str, ProvenDevice]:
        """The board, for each axis (`contid.hal.pulses.Proves`)."""
        from contid_drivers.due.identity import board
        from contid_drivers.due.session import ask_hello

        assert isinstance(options, DueBusOptions)
        return dict.fromkeys((axis.name for axis in axes), board(ask_hello(name, options)))


DRIVER: Driver = DueDriver()
