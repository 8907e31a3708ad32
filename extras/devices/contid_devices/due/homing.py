"""``contid home`` for a Due board."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from contextlib import closing

from contid.errors import DeviceError
from contid.hal import AxisOnBus, Homed, Report, Rest
from contid_driverkit.clock import MonotonicClock
from contid_driverkit.signals import defer_signals
from contid_drivers.due.bus import SILENCE_S, DueBus
from contid_drivers.due.codes import Reason
from contid_drivers.due.options import DueBusOptions
from contid_drivers.due.wiring import axis_options

_TICK_S = 0.005


def home(
    name: str, options: DueBusOptions, axes: Sequence[AxisOnBus], only: Sequence[str], report: Report
) -> list[Homed]:
    """Move axes to their reference one after the other; they rest afterwards.

    See `contid.hal.Homes`: the board searches the end stop of one axis after the other.
    """
    by_name = {axis.name: axis for axis in axes}
    for axis in only:
        if axis_options(by_name[axis]).homing is None:
            raise DeviceError(
                f"{name}: {axis}", "it has no homing", "add homing: {direction: ...} to the axis"
            )
    with closing(DueBus(name, options, axes, MonotonicClock())) as bus:
        bus.open()
        try:
            bus.clear_fault(only)
            return [_home_one(bus, by_name[axis], report) for axis in only]
        finally:
            with defer_signals():
                bus.disable(list(only), Rest.RELAX)


def park(
    name: str, options: DueBusOptions, axes: Sequence[AxisOnBus], only: Sequence[str], report: Report
) -> None:
    """Take the present pose of the axes ``only`` as their parked pose; moves nothing.

    See `contid.hal.Parks`: axes without homing stand at their ``power_up_deg``.
    """
    by_name = {axis.name: axis for axis in axes}
    for axis in only:
        if axis_options(by_name[axis]).homing is not None:
            raise DeviceError(
                f"{name}: {axis}", "it has homing and is not parked", f"contid home FILE {axis}"
            )
    with closing(DueBus(name, options, axes, MonotonicClock())) as bus:
        bus.open()
        bus.park(only)
        samples = bus.exchange({})
        for axis in only:
            at_deg = axis_options(by_name[axis]).power_up_deg
            report(f"{axis}: parked at {at_deg:g} deg (reads {math.degrees(samples[axis].value or 0.0):.2f})")


def _home_one(bus: DueBus, axis: AxisOnBus, report: Report) -> Homed:
    method = axis_options(axis).homing
    assert method is not None
    at_rad, device = math.radians(method.at_deg), f"{bus.name}: {axis.name}"
    axis.reference.require_former(device, at_rad, turns_lost=False)
    report(f"{axis.name}: towards its end stop at {method.speed_deg_s:g} deg/s, twice")
    bus.home([axis.name], moved=axis.reference.zero_rad is None)
    while True:
        sample = bus.exchange({})[axis.name]
        if sample.fault:
            raise DeviceError(device, sample.fault, _remedy(bus.reason(axis.name)))
        if sample.age_s > SILENCE_S:
            raise DeviceError(device, "it does not answer while homing", "check the board")
        if not bus.homing(axis.name):
            break
        time.sleep(_TICK_S)
    if not bus.homed(axis.name):
        raise DeviceError(device, "its search was stopped through the board's other port", "home it again")
    report(f"{axis.name}: stop found, backed off to {sample.value:.3f} rad")
    return Homed(axis.name, at_rad, method.at_mm, "end stop, found twice by the Due board")


def _remedy(reason: Reason | None) -> str:
    if reason is Reason.HOME_MOVED:
        return "look for what blocks its way; if it was rebuilt, `contid home --force`"
    if reason in (Reason.STALLED, Reason.ENCODER_SILENT, Reason.FOLLOWING):
        return "it stood still and does not move back: a jammed shaft or a dead encoder, no stop"
    return "clear the way, check couplings, encoder, direction and duty_percent"
