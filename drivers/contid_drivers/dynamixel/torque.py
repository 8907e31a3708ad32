"""Torque of the axes of a bus, all or none: on with their watchdogs, off or at rest, and recovery.

The Bus Watchdog of a servo stops it when no instruction comes for its time-out. It is also the witness of a
reset: a servo that resets loses its count of turns, and its watchdog is off.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence

from contid.errors import DeviceError, DeviceLostError
from contid.hal import Rest
from contid_drivers.dynamixel import arming, turns
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.axis import REST_PENDING, Axis, TorqueState
from contid_drivers.dynamixel.checks import identity
from contid_drivers.dynamixel.client import ServoError
from contid_drivers.dynamixel.link import BusLink, Opened

log = logging.getLogger(__name__)


def enable(link: BusLink, axes: Sequence[Axis]) -> None:
    """Put axes under torque where they stand, or leave all of them as they were (`contid.hal.Bus.enable`).

    1. No axis may have a fault, and each must be the servo of when the bus was opened. A rest that one has
       not confirmed is finished.
    2. Each servo still has its count of turns, and gets the settings of the robot file that differ.
    3. Goal := present position, torque on, read back, one servo after the other.
    4. The watchdogs come on together; with them `Axis.enabled` becomes True.
    5. One exchange reads the watchdogs back, and the counts of turns are checked again.

    When a step fails, torque that this call switched on goes off, and axes that were held before are held.

    Raises:
        DeviceError: a fault, a lost count, a setting that needs torque off, or a step without effect.
        DeviceLostError: the port is gone; nothing can be undone.
    """
    opened = link.need_open()
    client = opened.client
    chosen = [axis for axis in axes if not axis.enabled]
    for axis in chosen:
        if axis.fault:
            raise DeviceError(link.name, f"{axis.name}: {axis.fault}", "clear the fault first")
    started: list[Axis] = []
    try:
        for axis in chosen:
            identity.require_same(client, axis)
        for axis in chosen:
            arming.finish_rest(client, axis)
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
        _back_out(link, opened, chosen, started)
        raise


def _start_watchdogs(opened: Opened, chosen: Sequence[Axis], watchdog_ms: int) -> None:
    """Switch the watchdogs on and read them back in one exchange, which also feeds all of them.

    Raises:
        DeviceError: a watchdog does not come on, or a servo lost its count of turns meanwhile.
    """
    client = opened.client
    arming.start_watchdogs(client, chosen, watchdog_ms // reg.WATCHDOG_MS_PER_UNIT)
    readings = opened.cyclic.run({}, full=True)
    for axis in chosen:
        reading = readings.get(axis.device)
        watchdog = None if reading is None else reading.watchdog
        if watchdog is None:
            watchdog = client.read(axis.device, reg.BUS_WATCHDOG)
        if watchdog != axis.watchdog_units:
            raise DeviceError(client.name(axis.device), f"its Bus Watchdog does not come on: {watchdog}")
        # A reset before this point lost the count of turns and is found here. A later one clears the
        # watchdog too, which every exchange reads: that is how it is found then.
        turns.require_kept(client, axis)


def _back_out(link: BusLink, opened: Opened, chosen: Sequence[Axis], started: Sequence[Axis]) -> None:
    """Undo a failed `enable`: torque it switched on goes off, axes held before stay held."""
    if started:
        _relax(link, opened, started)
    held = [axis for axis in chosen if axis.watchdog_units and axis not in started]
    _hold(opened, [axis for axis in held if axis.state not in REST_PENDING])


def _relax(link: BusLink, opened: Opened, axes: Sequence[Axis]) -> None:
    """Torque off; where it is not confirmed it stays pending."""
    _ask_for(axes, TorqueState.RELAX_PENDING)
    silent = arming.torque_off(opened.client, axes)
    for axis in axes:
        if axis.name not in silent:
            axis.state = TorqueState.IDLE
    if silent:
        log.error("%s: torque off not confirmed by %s", link.name, ", ".join(silent))


def _hold(opened: Opened, axes: Sequence[Axis]) -> None:
    """Goal := present position, watchdog off; where that fails it stays pending."""
    _ask_for(axes, TorqueState.HOLD_PENDING)
    for axis in axes:
        try:
            arming.hold_position(opened.client, axis)
            axis.state = TorqueState.IDLE
        except ServoError as error:
            # Its watchdog stays on; without further instructions it trips and stops the servo.
            log.error("%s", error)


def _ask_for(axes: Sequence[Axis], pending: TorqueState) -> None:
    """From here on each axis is to rest, whatever becomes of the first attempt."""
    for axis in axes:
        axis.state = pending


def disable(link: BusLink, axes: Sequence[Axis], rest: Rest) -> None:
    """Bring axes to a rest (`contid.hal.Bus.disable`); failures are logged, never raised.

    ``hold`` leaves torque on with the goal at the present position. ``relax`` switches it off, and so does
    ``vent``, which servos cannot do. A servo that does not confirm keeps the rest as pending
    (`Axis.state`) until it answers, also over a loss of the port.
    """
    opened = link.reachable
    if opened is None:
        _ask_for(axes, TorqueState.HOLD_PENDING if rest is Rest.HOLD else TorqueState.RELAX_PENDING)
        return
    try:
        if rest is not Rest.HOLD:
            _relax(link, opened, axes)
            return
        _hold(opened, axes)
    except DeviceLostError as error:
        link.mark_lost(error)


def clear_fault(link: BusLink, axes: Sequence[Axis]) -> None:
    """Clear the faults of axes that have one or are not enabled (`contid.hal.Bus.clear_fault`).

    Raises:
        DeviceError: an axis is silent, or its cause of the fault persists.
        DeviceLostError: the port is gone.
    """
    client = link.need_open().client
    try:
        for axis in axes:
            if axis.fault or not axis.enabled:
                arming.recover(client, axis)
    except DeviceLostError as error:
        raise link.mark_lost(error) from None
