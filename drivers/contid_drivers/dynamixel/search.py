"""A slow search with a limited current: what homing against a stop and homing of tendons have in common."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import NamedTuple

from contid.errors import DeviceError
from contid_drivers.defer_signals import defer_signals
from contid_drivers.dynamixel import arming
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.axis import Axis
from contid_drivers.dynamixel.client import ServoClient
from contid_drivers.dynamixel.registers import Register

log = logging.getLogger(__name__)


def prepare(client: ServoClient, axis: Axis, speed_deg_s: float, current_ma: float) -> int:
    """Set the registers of a search, torque off; returns the present position [ticks].

    Raises:
        DeviceError: torque off is not confirmed.
    """
    device = axis.device
    if arming.torque_off(client, [axis]):
        raise DeviceError(client.name(device), "torque off is not confirmed")
    for register, value in (
        (reg.HOMING_OFFSET, 0),
        (reg.DRIVE_MODE, 0),
        (reg.OPERATING_MODE, reg.MODE_NUMBERS["current_based_position"]),
        (reg.PROFILE_VELOCITY, max(1, round(speed_deg_s / reg.DEG_S_PER_UNIT))),
        (reg.PROFILE_ACCELERATION, 0),
        (reg.GOAL_CURRENT, axis.model.to_units(current_ma)),
    ):
        if client.read(device, register) != value:
            client.write(device, register, value)
    axis.turns, axis.travel = 0, None
    return client.read(device, reg.PRESENT_POSITION)


def relax(client: ServoClient, axes: Sequence[Axis]) -> None:
    """Switch the torque off, not interrupted by signals; logs the axes that do not confirm it."""
    with defer_signals():
        if silent := arming.torque_off(client, axes):
            log.error(
                "%s: torque off not confirmed by %s; switch the power off", client.bus, ", ".join(silent)
            )


class Observed(NamedTuple):
    """Position of a searching servo, and the magnitude of its current."""

    ticks: int
    current_ma: float


def observe(client: ServoClient, axis: Axis) -> Observed:
    """Read position and current of a searching servo in one answer.

    Raises:
        DeviceError: a hardware error, a tripped watchdog, or a reset.
    """
    first, last = reg.HARDWARE_ERROR.address, reg.PRESENT_POSITION
    block = client.read_block(axis.device, first, last.address + last.size - first)

    def value(register: Register) -> int:
        begin = register.address - first
        return register.decode(block[begin : begin + register.size])

    name = client.name(axis.device)
    if bits := value(reg.HARDWARE_ERROR):
        raise DeviceError(name, f"hardware error while homing: {reg.describe_hardware_error(bits)}")
    if value(reg.BUS_WATCHDOG) != axis.armed:
        raise DeviceError(name, "its watchdog tripped or it reset itself while homing", "home again")
    return Observed(value(last), abs(value(reg.PRESENT_CURRENT)) * (axis.model.ma_per_unit or 0.0))
