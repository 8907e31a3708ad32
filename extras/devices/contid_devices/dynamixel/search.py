"""A slow search with a limited current: what homing against a stop and homing of tendons have in common."""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from contid.errors import DeviceError
from contid_driverkit.signals import defer_signals
from contid_drivers.dynamixel import arming, turns
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.axis import Axis, Turn
from contid_drivers.dynamixel.client import ServoClient
from contid_drivers.dynamixel.registers import Register

log = logging.getLogger(__name__)

POLL_S: Final = 0.005
#: A servo stands still while its position changes by less than this; a way back has arrived within it.
STILL_TICKS: Final = 3
#: A way back without motion for this time goes no further.
STUCK_S: Final = 0.5
#: Time-out of the watchdogs of a search, in all and per servo: servos are read one after the other, a slow
#: adapter takes this long for one, and a host without real-time rights pauses. Their current is limited.
PAUSE_MS: Final = 300
LOOK_MS: Final = 60


def prepare(client: ServoClient, axis: Axis, speed_deg_s: float, current_ma: float) -> int:
    """Set the registers of a search, torque off; returns the present position [ticks].

    Turns that the servo keeps (`contid_drivers.dynamixel.turns`) are stored in it again behind the writes;
    without them `Axis.turn` is unknown, and the turns are 0.

    Raises:
        DeviceError: torque off is not confirmed.
    """
    device = axis.device
    if arming.torque_off(client, [axis]):
        raise DeviceError(client.name(device), "torque off is not confirmed")
    kept = turns.kept(client, axis)
    for register, value in (
        (reg.HOMING_OFFSET, 0),
        (reg.DRIVE_MODE, 0),
        (reg.OPERATING_MODE, reg.MODE_NUMBERS["current_based_position"]),
        (reg.PROFILE_VELOCITY, max(1, round(speed_deg_s / reg.DEG_S_PER_UNIT))),
        (reg.PROFILE_ACCELERATION, 0),  # no limit
        (reg.GOAL_CURRENT, axis.model.to_units(current_ma)),
    ):
        if client.read(device, register) != value:
            client.write(device, register, value)
    axis.turns, axis.turn, axis.travel = 0, Turn.UNKNOWN, None
    if kept is not None:
        # A change of the operating mode has cleared Velocity I Gain, one of its two registers.
        turns.store(client, axis, kept)
    return client.read(device, reg.PRESENT_POSITION)


def arm(client: ServoClient, axes: Sequence[Axis], watchdog_ms: int) -> None:
    """Switch the torque of searching axes on, under watchdogs that are no shorter than the robot file's."""
    for axis in axes:
        arming.arm(client, axis)
    longest_ms = reg.BUS_WATCHDOG.high * reg.WATCHDOG_MS_PER_UNIT
    most_ms = min(max(watchdog_ms, PAUSE_MS, LOOK_MS * len(axes)), longest_ms)
    arming.start_watchdogs(client, list(axes), most_ms // reg.WATCHDOG_MS_PER_UNIT)


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
        message = f"hardware error while homing: {reg.describe_hardware_error(bits)}"
        raise DeviceError(name, message, reg.remedy_of_hardware_error(bits))
    if value(reg.BUS_WATCHDOG) != axis.watchdog_units:
        raise DeviceError(name, "its watchdog tripped or it reset itself while homing", "home again")
    return Observed(value(last), abs(value(reg.PRESENT_CURRENT)) * (axis.model.ma_per_unit or 0.0))


def move_back(
    client: ServoClient, axes: Sequence[Axis], stops: Mapping[int, int], backs: Mapping[int, int]
) -> None:
    """Move axes under torque back from where they stood still, and require that they did; by device [ticks].

    Raises:
        DeviceError: one did not: it is jammed, or its encoder is dead.
    """
    for axis in axes:
        client.write(axis.device, reg.GOAL_POSITION, backs[axis.device])
    positions, moved_s = dict(stops), dict.fromkeys(stops, time.monotonic())
    while True:
        time.sleep(POLL_S)
        # Every axis is read in every round: the reads feed the watchdogs.
        for axis in axes:
            position = observe(client, axis).ticks
            if abs(position - positions[axis.device]) >= STILL_TICKS:
                positions[axis.device], moved_s[axis.device] = position, time.monotonic()
        under_way = [a for a in axes if abs(positions[a.device] - backs[a.device]) > STILL_TICKS]
        if not any(time.monotonic() - moved_s[axis.device] < STUCK_S for axis in under_way):
            break
    for axis in axes:
        stop, back = stops[axis.device], backs[axis.device]
        moved = (positions[axis.device] - stop) * (1 if back > stop else -1)
        name, rad = client.name(axis.device), reg.RAD_PER_TICK
        axis.reference.require_way_back(name, moved * rad, abs(back - stop) * rad)
