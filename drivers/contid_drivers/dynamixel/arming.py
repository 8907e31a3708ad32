"""Settings, arming without a jump, rest and recovery of Dynamixel servos."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from typing import Final

from contid.errors import DeviceError
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel import turns
from contid_drivers.dynamixel.axis import KNOWN_TURNS, Axis, TorqueState, Turn
from contid_drivers.dynamixel.checks import identity
from contid_drivers.dynamixel.client import TRIES, NoAnswerError, ServoClient, ServoError, ServoRefusedError
from contid_drivers.dynamixel.grip import goal_current, limit_ma, read_own_limit
from contid_drivers.dynamixel.mapping import map_block
from contid_drivers.dynamixel.options import DynamixelBusOptions
from contid_drivers.dynamixel.packets import sync_write
from contid_drivers.dynamixel.registers import Register

log = logging.getLogger(__name__)

#: A position further outside the robot file's travel means another turn or another zero.
TRAVEL_SLACK_RAD: Final = math.radians(20.0)


def settings(axis: Axis, options: DynamixelBusOptions) -> list[tuple[Register, int]]:
    """Register values required by the robot file, EEPROM first; changing the mode resets those after it."""
    a = axis.options
    values: list[tuple[Register, int | None]] = [
        (reg.RETURN_DELAY, options.return_delay_us // 2),
        (reg.DRIVE_MODE, 0),
        (reg.OPERATING_MODE, axis.operating_mode),
        (reg.HOMING_OFFSET, 0),
        # Other servos may have this id as their second one, and this one that of others.
        (reg.SECONDARY_ID, reg.SECONDARY_ID.default),
        # Bit 0 switches torque on after a brown-out, in an unchecked turn.
        (reg.STARTUP, 0),
        (reg.CURRENT_LIMIT, _units(axis, a.current_limit_ma)),
        (reg.PROFILE_VELOCITY, _profile(a.profile_velocity_deg_s / reg.DEG_S_PER_UNIT)),
        (reg.PROFILE_ACCELERATION, _profile(a.profile_acceleration_deg_s2 / reg.DEG_S2_PER_UNIT)),
        (reg.GOAL_CURRENT, _goal_current(axis)),
        # Limits the torque in position modes as well.
        (reg.GOAL_PWM, axis.own_pwm),
        (reg.POSITION_P, a.position_p),
        (reg.POSITION_I, a.position_i),
        (reg.POSITION_D, a.position_d),
    ]
    return [(register, value) for register, value in values if value is not None]


def _profile(units: float) -> int:
    """Value of a profile register, in which 0 is no limit: a slower one than the slowest is the slowest."""
    return max(1, round(units)) if units else 0


def _goal_current(axis: Axis) -> int | None:
    """Goal Current: an earlier grip, or a search for a stop, may have left another one in the servo."""
    return goal_current(axis) if limit_ma(axis) else _units(axis, axis.options.goal_current_ma)


def _units(axis: Axis, current_ma: float | None) -> int | None:
    return None if current_ma is None else axis.model.to_units(current_ma)


def present(client: ServoClient, device: int, register: Register) -> int | None:
    """What a servo has in a setting; None where older firmware has none, which is then not active."""
    try:
        return client.read(device, register)
    except ServoRefusedError:
        if register is reg.STARTUP:
            return None
        raise


def configure(client: ServoClient, axis: Axis, options: DynamixelBusOptions) -> None:
    """Write the settings that differ; torque stays as it is, on or off, and so does the position.

    Raises:
        DeviceError: an EEPROM setting differs and torque is on.
    """
    device = axis.device
    torque = client.read(device, reg.TORQUE_ENABLE)
    if client.read(device, reg.BUS_WATCHDOG) != 0:
        # A tripped watchdog refuses every goal, and Goal Current is one.
        hold_position(client, axis)
    read_own_limit(client, axis)
    for register, value in settings(axis, options):
        found = present(client, device, register)
        if found in (None, value):
            continue
        if register.eeprom and torque:
            raise DeviceError(
                client.name(device),
                f"{register.name} is {found}, the robot file requires {value}, and torque is on",
                "it can only be changed without torque: support the robot and relax it first",
            )
        under = " under torque" if torque else ""
        log.info("%s: %s %d -> %d%s", client.name(device), register.name, found, value, under)
        client.write(device, register, value)
        if register is reg.OPERATING_MODE:
            turns.store(client, axis, axis.turns)
    axis.return_delay_s = options.return_delay_us / 1e6


def require_inside_travel(client: ServoClient, axis: Axis, position: int) -> None:
    """Refuse a position outside the axis's travel: the first command would be a long motion.

    Raises:
        DeviceError: a wrong turn or a wrong zero.
    """
    if axis.travel is None:
        return
    angle, (low, high) = axis.to_rad(position), axis.travel
    if not low - TRAVEL_SLACK_RAD <= angle <= high + TRAVEL_SLACK_RAD:
        remedy = "a wrong turn or a wrong zero_deg: run `contid home`, or bring it inside by hand"
        if axis.options.homing is None:
            remedy = (
                "without `homing` its count begins between 0 and 360 deg at power-up: configure homing, or "
                "set zero_deg to its angle at power-up"
            )
        raise DeviceError(
            client.name(axis.device),
            f"it stands at {math.degrees(angle):.1f} deg, outside its travel of "
            f"{math.degrees(low):.1f}..{math.degrees(high):.1f} deg",
            remedy,
        )


def arm(client: ServoClient, axis: Axis) -> None:
    """Goal := present, torque on, read back; the servo holds its position, without a watchdog.

    Torque may be on before and is on afterwards. `start_watchdogs`, for all axes at once, must follow; only
    that sets `Axis.enabled`.

    Raises:
        DeviceError: silent, faulty, or a step had no effect.
    """
    device = axis.device
    if bits := client.read(device, reg.HARDWARE_ERROR):
        raise DeviceError(
            client.name(device),
            f"hardware error: {reg.describe_hardware_error(bits)}",
            f"{reg.remedy_of_hardware_error(bits)}; then clear-fault, which reboots it",
        )
    require_inside_travel(client, axis, client.read(device, reg.PRESENT_POSITION))
    hold_position(client, axis)
    client.write(device, reg.TORQUE_ENABLE, 1)
    if client.read(device, reg.TORQUE_ENABLE) != 1:
        raise DeviceError(client.name(device), "torque does not come on")


def start_watchdogs(client: ServoClient, axes: Sequence[Axis], watchdog: int) -> None:
    """Bus Watchdog on in all axes at once: one after the other, the first would trip before the last has it.

    Their torque is on before. From here on `Axis.enabled` is True: commands are sent. Nothing confirms the
    watchdogs; the next exchange reads them back.

    Args:
        client: client of their bus.
        axes: the servos.
        watchdog: time-out in units of 20 ms.
    """
    value = reg.BUS_WATCHDOG.encode(watchdog)
    client.port.send(sync_write(reg.BUS_WATCHDOG.address, 1, [(axis.device, value) for axis in axes]))
    for axis in axes:
        axis.arm(watchdog)


def hold_position(client: ServoClient, axis: Axis) -> None:
    """Switch the watchdog off, tripped or not, and set the goal to the present position.

    Torque stays as it is, on or off. Both go out in one write, so that a servo with torque and an old goal
    does not start towards it; one read confirms both.

    Raises:
        ServoError: it does not confirm them.
    """
    device, present = axis.device, reg.PRESENT_POSITION
    # A silent servo costs the others on its bus one time-out at most.
    tries = 1 if axis.misses else TRIES
    release = sync_write(reg.BUS_WATCHDOG.address, 1, [(device, b"\0")])
    for _ in range(TRIES):
        # Read again each time: a servo in motion has left a position that is a time-out old.
        position = present.decode(client.read_block(device, present.address, present.size, tries))
        stay = sync_write(reg.GOAL_POSITION.address, 4, [(device, reg.GOAL_POSITION.encode(position))])
        client.port.flush()
        client.port.send(release + stay)
        axis.watchdog_units = 0
        first, goal = reg.BUS_WATCHDOG, reg.GOAL_POSITION
        found = client.read_block(device, first.address, goal.address + goal.size - first.address)
        if not found[0] and goal.decode(found[-goal.size :]) == position:
            return
    client.write(device, reg.BUS_WATCHDOG, 0)
    client.write(device, reg.GOAL_POSITION, position)


def rest(client: ServoClient, axis: Axis, position: int | None) -> None:
    """Apply the pending rest of a servo that answers again; in a tick, so with one try.

    It stays pending until a read confirms it.

    Args:
        client: client of its bus.
        axis: the servo.
        position: its position in this exchange, None when the exchange did not read it.

    Raises:
        ServoError: it is silent again.
    """
    device, present = axis.device, reg.PRESENT_POSITION
    if position is None:
        position = present.decode(client.look(device, present.address, present.size))
    holds = axis.state is TorqueState.HOLD_PENDING
    register, value = (reg.GOAL_POSITION, position) if holds else (reg.TORQUE_ENABLE, 0)
    watchdog_off = sync_write(reg.BUS_WATCHDOG.address, 1, [(device, b"\0")])
    if holds and not axis.watchdog_units:  # one of an earlier run that has tripped takes no goal
        client.port.send(watchdog_off)
    client.port.send(sync_write(register.address, register.size, [(device, register.encode(value))]))
    if register.decode(client.look(device, register.address, register.size)) != value:
        return
    if not holds:  # where torque is off, a watchdog that stays on moves nothing
        client.port.send(watchdog_off)
        axis.watchdog_units = 0
    if axis.turn is Turn.LOST:
        turns.adopt(client, axis, position)
    axis.state = TorqueState.IDLE


def torque_off(client: ServoClient, axes: Sequence[Axis]) -> list[str]:
    """Torque off, confirmed by a read, then watchdog off.

    All axes get the packet, ``TRIES`` times at most. Dead servos are not asked for a confirmation: every
    time-out would freeze the goals of the others on the bus.

    Returns:
        The names of the axes that did not confirm; the torque of these may be on.

    Raises:
        DeviceLostError: the port is gone.
    """
    packet = sync_write(reg.TORQUE_ENABLE.address, 1, [(axis.device, b"\0") for axis in axes])
    dead = [axis for axis in axes if axis.dead]
    asked = [axis for axis in axes if axis not in dead]
    for _ in range(TRIES):
        client.port.flush()
        client.port.send(packet)
        asked = [axis for axis in asked if not _torque_is_off(client, axis)]
        if not asked and not dead:
            break
    silent = dead + asked
    for axis in axes:
        axis.stop_commands()
    for axis in axes:
        axis.watchdog_units = 0
        if axis not in silent:
            _watchdog_off(client, axis)
    return [axis.name for axis in silent]


def _watchdog_off(client: ServoClient, axis: Axis) -> None:
    """Watchdog off; a failure is only logged: where torque is off, a watchdog that trips moves nothing.

    Raises:
        DeviceLostError: the port is gone.
    """
    try:
        client.write(axis.device, reg.BUS_WATCHDOG, 0)
    except ServoError as error:
        log.error("%s", error)


def _torque_is_off(client: ServoClient, axis: Axis) -> bool:
    torque = reg.TORQUE_ENABLE
    try:
        return client.read_block(axis.device, torque.address, torque.size, tries=1) == b"\0"
    except ServoError:
        return False


def finish_rest(client: ServoClient, axis: Axis) -> None:
    """Bring a servo to the rest that it has not confirmed yet, if there is one; not for a tick.

    Raises:
        ServoError: it still does not confirm it, and the rest stays pending.
    """
    if axis.state is TorqueState.RELAX_PENDING and torque_off(client, [axis]):
        remedy = "check its cable, or switch its power off"
        raise NoAnswerError(client.name(axis.device), "torque off is not confirmed", remedy)
    if axis.state is TorqueState.HOLD_PENDING:
        hold_position(client, axis)
    axis.state = TorqueState.IDLE


def recover(client: ServoClient, axis: Axis) -> None:
    """Bring a faulty servo to a state that can be armed, without moving it.

    Torque stays as it is, but a rest that is pending is finished first, and a servo with a hardware error is
    rebooted: its torque is off then.

    Raises:
        DeviceError: it is silent, a rest is not confirmed, the fault persists, or its turn count cannot be
            inferred.
    """
    device = axis.device
    if axis.dead:
        # Every time-out of a dead servo would freeze the goals of the others on its bus.
        raise NoAnswerError(client.name(device), "no answer", "check its power")
    identity.require_same(client, axis)
    finish_rest(client, axis)
    if client.read(device, reg.HARDWARE_ERROR):
        if axis.turn in KNOWN_TURNS:
            axis.seen = axis.to_rad(client.read(device, reg.PRESENT_POSITION))
        client.reboot(device)
        if bits := client.read(device, reg.HARDWARE_ERROR):
            raise DeviceError(
                client.name(device),
                f"hardware error persists: {reg.describe_hardware_error(bits)}",
                reg.remedy_of_hardware_error(bits),
            )
    if client.read(device, reg.STATUS_RETURN_LEVEL) != reg.STATUS_RETURN_LEVEL.default:
        client.write(device, reg.STATUS_RETURN_LEVEL, reg.STATUS_RETURN_LEVEL.default)
    map_block(client, axis)
    turns.settle(client, axis)
    if client.read(device, reg.BUS_WATCHDOG) != 0:
        hold_position(client, axis)
    axis.watchdog_units, axis.hardware_error, axis.fault, axis.misses = 0, 0, "", 0
    axis.state = TorqueState.IDLE
