"""Torque of the axes of a bus, all or none: on with their watchdogs, off or at rest, and recovery."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from contid.errors import DeviceError, DeviceLostError
from contid.hal import Rest
from contid_drivers.dynamixel import arming, turns
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.axis import Axis
from contid_drivers.dynamixel.link import BusLink, Opened

log = logging.getLogger(__name__)


def enable(link: BusLink, axes: Sequence[Axis]) -> None:
    """See `contid.hal.Bus.enable`."""
    opened = link.need_open()
    client = opened.client
    chosen = [axis for axis in axes if not axis.enabled]
    for axis in chosen:
        if axis.fault:
            raise DeviceError(link.name, f"{axis.name}: {axis.fault}", "clear the fault first")
    started: list[Axis] = []
    try:
        for axis in chosen:
            turns.require_kept(client, axis)
            arming.configure(client, axis, link.options)
        link.adopt_return_delay(client)
        for axis in chosen:
            if not client.read(axis.device, reg.TORQUE_ENABLE):
                started.append(axis)
            arming.arm(client, axis)
        if chosen:
            _start_watchdogs(opened, chosen, link.options.watchdog_ms)
    except DeviceLostError as error:
        raise link.mark_lost(error) from None
    except DeviceError:
        _back_out(opened, chosen, started)
        raise


def _start_watchdogs(opened: Opened, chosen: Sequence[Axis], watchdog_ms: int) -> None:
    """Watchdogs on, read back in one exchange, which also feeds all of them."""
    client = opened.client
    arming.start_watchdogs(client, chosen, watchdog_ms // reg.WATCHDOG_MS_PER_UNIT)
    readings = opened.cyclic.run({}, full=True)
    for axis in chosen:
        reading = readings.get(axis.device)
        found = None if reading is None else reading.watchdog
        if found is None:
            found = client.read(axis.device, reg.BUS_WATCHDOG)
        if found != axis.armed:
            raise DeviceError(client.name(axis.device), f"its Bus Watchdog does not come on: {found}")
        # From here on the watchdog, which a reset clears, stands for the count.
        turns.require_kept(client, axis)


def _back_out(opened: Opened, chosen: Sequence[Axis], started: Sequence[Axis]) -> None:
    """Undo a failed `enable`: torque it switched on goes off, axes held before stay held."""
    if started:
        arming.torque_off(opened.client, started)
    for axis in chosen:
        axis.enabled = False
        if axis.armed and axis not in started:
            arming.hold_position(opened.client, axis)


def disable(link: BusLink, axes: Sequence[Axis], rest: Rest) -> None:
    """See `contid.hal.Bus.disable`; servos cannot vent, so ``vent`` relaxes them."""
    opened = link.reachable
    if opened is None:
        return
    try:
        if rest is not Rest.HOLD:
            silent = arming.torque_off(opened.client, axes)
            for axis in axes:
                axis.pending_rest = Rest.RELAX if axis.name in silent else None
            if silent:
                log.error("%s: torque off not confirmed by %s", link.name, ", ".join(silent))
            return
        for axis in axes:
            axis.enabled, axis.pending_rest = False, Rest.HOLD
            try:
                arming.hold_position(opened.client, axis)
                axis.pending_rest = None
            except DeviceLostError:
                raise
            except DeviceError as error:
                # Its watchdog stays armed and will hold it where it is.
                log.error("%s", error)
    except DeviceLostError as error:
        link.mark_lost(error)
    except DeviceError as error:
        log.error("%s", error)


def clear_fault(link: BusLink, axes: Sequence[Axis]) -> None:
    """See `contid.hal.Bus.clear_fault`."""
    client = link.need_open().client
    try:
        for axis in axes:
            if axis.fault or not axis.enabled:
                arming.recover(client, axis)
    except DeviceLostError as error:
        raise link.mark_lost(error) from None
