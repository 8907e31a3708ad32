"""Homing: find the reference of an axis, against a hard stop with low current or by its stored pose.

Against a stop: current-based position mode with a small Goal Current, a slow profile, the Bus Watchdog armed,
and a goal beyond the stop. The stop is where the servo stands still with its current at the limit, found
twice with a way back between (`contid.hal.homing`). Torque is switched off afterwards in every case. The
port's lock excludes other processes that drive the bus.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from contextlib import closing
from typing import Final

from contid.errors import DeviceError
from contid.hal import AxisOnBus, Homed, Report
from contid.hal.homing import BACKOFF_MIN_DEG
from contid.kit.remembered import memory_of
from contid.kit.serial_ports import find_port
from contid_devices.dynamixel import search
from contid_devices.dynamixel.tensioning import tension
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel import turns
from contid_drivers.dynamixel.axis import KNOWN_TURNS, Axis
from contid_drivers.dynamixel.checks import identity
from contid_drivers.dynamixel.client import ServoClient
from contid_drivers.dynamixel.link import handshake
from contid_drivers.dynamixel.options import DynamixelBusOptions, HardStop, SingleTurn, Tensioning
from contid_drivers.dynamixel.port import ServoPort

POLL_S: Final = 0.01
#: Standing still for this time, with this share of the current.
STILL_S: Final = 0.25
PUSHING: Final = 0.8


def home(
    name: str, options: DynamixelBusOptions, axes: Sequence[AxisOnBus], only: Sequence[str], report: Report
) -> list[Homed]:
    """Move axes to their reference one after the other; they rest afterwards (`contid.hal.Homes.home`)."""
    states = [Axis.of(axis, options) for axis in axes]
    chosen = [axis for axis in states if axis.name in only]
    for axis in chosen:
        if axis.options.homing is None:
            raise DeviceError(
                name, f"{axis.name} has no homing", "add `homing: {method: hard_stop, ...}` to the axis"
            )
    path = find_port(name, options.port)
    with closing(ServoPort(name, path, options.baud, options.usb_latency_ms / 1e3)) as port:
        client = ServoClient(name, port, {axis.device: axis.name for axis in states})
        handshake(client, states, options)
        identity.require_known(client, states, memory_of(name, options.port, path, axes))
        for axis in states:
            if client.read(axis.device, reg.TORQUE_ENABLE) and client.read(axis.device, reg.MOVING):
                raise DeviceError(client.name(axis.device), "it is moving", "stop its robot first")
        try:
            tendons = [axis for axis in chosen if isinstance(axis.options.homing, Tensioning)]
            found = [_home_one(client, axis, options, report) for axis in chosen if axis not in tendons]
            if tendons:
                found += tension(client, tendons, options, report)
                search.relax(client, tendons)
            return found
        except BaseException:
            # An interrupt may arrive between the end of a search and its torque off.
            search.relax(client, [a for a in chosen if not isinstance(a.options.homing, SingleTurn)])
            raise


def _home_one(client: ServoClient, axis: Axis, options: DynamixelBusOptions, report: Report) -> Homed:
    homing = axis.options.homing
    if isinstance(homing, SingleTurn):
        return _by_pose(client, axis, homing, report)
    assert isinstance(homing, HardStop)
    try:
        return _by_stop(client, axis, homing, options, report)
    finally:
        search.relax(client, [axis])


def _by_pose(client: ServoClient, axis: Axis, homing: SingleTurn, report: Report) -> Homed:
    turns.forget(client, axis)
    turns.settle(client, axis)
    value = axis.to_rad(client.read(axis.device, reg.PRESENT_POSITION))
    off_deg = math.degrees(value) - homing.pose_deg
    report(f"{axis.name}: {math.degrees(value):.2f} deg, {off_deg:+.2f} deg from its stored pose")
    axis.reference.require_former(client.name(axis.device), value, turns_lost=False)
    return Homed(axis.name, value, homing.at_mm, f"stored pose, {off_deg:+.2f} deg from it")


def _by_stop(
    client: ServoClient, axis: Axis, homing: HardStop, options: DynamixelBusOptions, report: Report
) -> Homed:
    device = axis.device
    start = search.prepare(client, axis, homing.speed_deg_s, homing.current_ma)
    search.arm(client, [axis], options.watchdog_ms)
    report(f"{axis.name}: searching its stop with {homing.current_ma} mA")
    first = _until_blocked(client, axis, homing, start)
    report(f"{axis.name}: stands still at {math.degrees(axis.to_rad(first)):.2f} deg, once more")
    stop = _until_blocked(client, axis, homing, _move_back(client, axis, homing, first))
    name = client.name(device)
    axis.reference.require_repetition(name, axis.to_rad(first), axis.to_rad(stop))
    _move_back(client, axis, homing, stop)
    value = axis.to_rad(stop)
    report(f"{axis.name}: stop at {math.degrees(value):.2f} deg")
    axis.reference.require_former(name, value, turns_lost=axis.turn not in KNOWN_TURNS)
    turns.store(client, axis, axis.turns)
    travelled = abs(first - start) / reg.TICKS_PER_DEG
    how = f"hard stop with {homing.current_ma} mA after {travelled:.0f} deg"
    return Homed(axis.name, value, homing.at_mm, how)


def _move_back(client: ServoClient, axis: Axis, homing: HardStop, stop: int) -> int:
    """Back off from a stop [ticks]; returns where to."""
    backoff_deg = max(homing.backoff_deg, BACKOFF_MIN_DEG)
    back = stop - homing.direction * round(backoff_deg * reg.TICKS_PER_DEG)
    search.move_back(client, [axis], {axis.device: stop}, {axis.device: back})
    return back


def _until_blocked(client: ServoClient, axis: Axis, homing: HardStop, start: int) -> int:
    """Search from ``start``: the position [ticks] of standstill with the current at its limit."""
    reach = round(homing.speed_deg_s * homing.timeout_s * reg.TICKS_PER_DEG)
    client.write(axis.device, reg.GOAL_POSITION, start + homing.direction * reach)
    until = time.monotonic() + homing.timeout_s
    still_since, last = time.monotonic(), start
    while True:
        time.sleep(POLL_S)
        position, current = search.observe(client, axis)
        now = time.monotonic()
        if abs(position - last) >= search.STILL_TICKS or current < PUSHING * homing.current_ma:
            still_since, last = now, position
        elif now - still_since >= STILL_S:
            return position
        if now > until:
            went_deg = (position - start) / reg.TICKS_PER_DEG
            raise DeviceError(
                client.name(axis.device),
                f"no stop found within {homing.timeout_s:g} s: it moved {went_deg:+.0f} deg "
                f"with {current:.0f} of {homing.current_ma} mA",
                "check direction, speed and current of its homing",
            )
