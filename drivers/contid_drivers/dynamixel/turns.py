"""The whole turns of a servo: kept in its RAM, and determined before its axis may move.

A servo that is powered up counts from 0 to 4095 ticks, in whichever turn its shaft is. `Axis.turns` is added
to that count; one too many is a rack that is longer by the circumference of its pinion. The turns are kept in
two registers in the RAM of the servo, which lose them when the servo loses its count:

* the *gain* (Velocity I Gain, unused in the position modes) holds 4096 + turns. A change of the operating
  mode clears it, and through position mode the servo loses its count without a power-off (e-manual, register
  132);
* the *address* (the last Indirect Address, where the servo has one) holds 145 + turns. Only a power-off
  clears it, to 227 or 243 by model. Without the gain it shows that another program reset the count.

`settle` decides in which turn the shaft is, by the first row that applies:

======================================  =========================================================
the servo                               the turn
======================================  =========================================================
has the gain, in a mode with turns      that of the gain
was seen since contid started           the nearest to its last position, within `SEEN_TOLERANCE_RAD`
has the address alone                   refused: another program reset the count in mid-travel
homes by a stored pose                  the nearest to that pose, within ``plausible_deg``
homes by a stop or by tension           refused until it was homed
has no homing                           0, unchecked, with a warning
======================================  =========================================================

All of it holds for a position that counts from the zero of the encoder, forwards. Another program may have
set a Homing Offset or the reverse direction: `settle` writes 0 to both first, or refuses under torque, which
locks them.

Not detectable: a CLEAR sent by another program while contid does not run.
"""

from __future__ import annotations

import logging
import math
from typing import Final, NamedTuple

from contid.errors import DeviceError
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.axis import Axis, Turn
from contid_drivers.dynamixel.client import ServoClient, ServoRefusedError
from contid_drivers.dynamixel.options import HardStop, SingleTurn, Tensioning
from contid_drivers.dynamixel.packets import sync_write
from contid_drivers.dynamixel.plausibility import FAR_RAD
from contid_drivers.dynamixel.registers import Register

log = logging.getLogger(__name__)

LAST_ADDRESS: Final = next(r for r in reg.TABLE if r.name == f"indirect address {reg.INDIRECT_COUNT}")
#: Values of the two registers for 0 turns; no model has such a gain by default.
_ADDRESS_ZERO: Final = 145
_GAIN_ZERO: Final = 4096
_MULTI_TURN_MODES: Final = tuple(reg.MODE_NUMBERS.values())
#: Greatest number of turns that is stored.
TURNS_MAX: Final = 80
#: Greatest motion assumed between the last reading (``axis.seen``) and the first one after a reset.
SEEN_TOLERANCE_RAD: Final = FAR_RAD
#: Bit of Drive Mode that reverses the count.
_REVERSE: Final = 0x01
#: The two registers after a power-up.
_CLEARED: Final = ((LAST_ADDRESS, LAST_ADDRESS.default), (reg.VELOCITY_I, reg.VELOCITY_I.default))


def stored_values(turns: int) -> tuple[tuple[Register, int], ...]:
    """The two registers that keep the turns, with their values: the address, then the gain."""
    return (LAST_ADDRESS, _ADDRESS_ZERO + turns), (reg.VELOCITY_I, _GAIN_ZERO + turns)


def store(client: ServoClient, axis: Axis, turns: int) -> None:
    """Take turns as those of the axis, and store them in the servo for as long as it is powered.

    In position mode, which counts no turns, they are kept on the host only.

    Raises:
        DeviceError: too many turns.
    """
    if abs(turns) > TURNS_MAX:
        raise DeviceError(client.name(axis.device), f"{turns} turns from its zero; {TURNS_MAX} can be kept")
    axis.turns, axis.turn = turns, Turn.ON_HOST
    if _counts_turns(client, axis):
        address, gain = stored_values(turns)
        client.write(axis.device, *gain)
        axis.turn = Turn.IN_SERVO
        _write_where_present(client, axis, *address)


def forget(client: ServoClient, axis: Axis) -> None:
    """Clear both registers, as a power-up does, and the last position: after it was parked by hand."""
    axis.seen = None
    for register, value in _CLEARED:
        _write_where_present(client, axis, register, value)


def _counts_turns(client: ServoClient, axis: Axis) -> bool:
    """True in an operating mode that keeps the count of turns."""
    return client.read(axis.device, reg.OPERATING_MODE) in _MULTI_TURN_MODES


def _write_where_present(client: ServoClient, axis: Axis, register: Register, value: int) -> None:
    """Write a register that some models do not have."""
    try:
        client.write(axis.device, register, value)
    except ServoRefusedError as error:
        log.info("%s: %s", client.name(axis.device), error.message)


def kept(client: ServoClient, axis: Axis) -> int | None:
    """The turns that the servo keeps; None when its count is not valid."""
    stored = client.read(axis.device, reg.VELOCITY_I) - _GAIN_ZERO
    return stored if abs(stored) <= TURNS_MAX and _counts_turns(client, axis) else None


def has_reset(client: ServoClient, axis: Axis) -> bool:
    """Whether the servo no longer keeps the turns of its axis; in a tick, so with one try.

    Raises:
        NoAnswerError: it is silent.
    """
    gain = reg.VELOCITY_I
    return gain.decode(client.look(axis.device, gain.address, gain.size)) != _GAIN_ZERO + axis.turns


def adopt(client: ServoClient, axis: Axis, position: int) -> None:
    """Store the turn of a servo that reset, nearest to where it was last seen; in a tick, so unconfirmed.

    Without one near enough both registers are cleared, so that `settle` refuses the axis.
    """
    if axis.seen is None:
        return
    turns = _nearest(position, axis.seen)
    near = abs(turns) <= TURNS_MAX and abs(_offset(position, axis.seen)) <= SEEN_TOLERANCE_RAD
    for register, value in stored_values(turns) if near else _CLEARED:
        data = register.encode(value)
        client.port.send(sync_write(register.address, register.size, [(axis.device, data)]))


def require_kept(client: ServoClient, axis: Axis) -> None:
    """Refuse to arm a servo whose count is not the one that `settle` has found.

    Raises:
        DeviceError: it reset itself, or another program reset its count; or its turn cannot be inferred.
    """
    if axis.turn is not Turn.IN_SERVO or _displacement(client, axis):
        settle(client, axis)
    elif kept(client, axis) != axis.turns:
        axis.latch_reset()
        raise DeviceError(client.name(axis.device), axis.fault, "clear-fault, once it is safe to move")


def settle(client: ServoClient, axis: Axis) -> None:
    """Determine the turn before the axis may move, by the table above.

    Raises:
        DeviceError: it cannot be inferred, or its position is displaced and torque is on.
    """
    if axis.turn is not Turn.LOST:
        axis.turn = Turn.UNKNOWN
    displaced = _displacement(client, axis)
    if displaced:
        _count_from_encoder(client, axis, displaced)
    if not _take_stored(client, axis, was_displaced=bool(displaced)):
        _infer(client, axis)


def _take_stored(client: ServoClient, axis: Axis, was_displaced: bool) -> bool:
    """Take the turns that the servo keeps; whether it keeps any that are valid.

    Where its position was displaced while contid ran, either the last position or the turns stored by it are
    of another scale: they are taken if both agree, and forgotten otherwise.
    """
    stored = kept(client, axis)
    if stored is None:
        return False
    position = client.read(axis.device, reg.PRESENT_POSITION)
    if was_displaced and axis.seen is not None and stored != _nearest(position, axis.seen):
        client.write(axis.device, reg.VELOCITY_I, reg.VELOCITY_I.default)
        axis.seen = None
        return False
    axis.turns, axis.turn = stored, Turn.IN_SERVO
    axis.seen = axis.to_rad(position)
    return True


def _infer(client: ServoClient, axis: Axis) -> None:
    """Infer the turns from where the axis should stand, and store them; 0 where nothing is known.

    Raises:
        DeviceError: it stands too far from there, or has to be homed.
    """
    expected = _expected(client, axis)
    position = client.read(axis.device, reg.PRESENT_POSITION)
    turns = 0
    if expected is not None:
        turns, off_rad = _nearest(position, expected.angle_rad), _offset(position, expected.angle_rad)
        if abs(off_rad) > expected.tolerance_rad:
            raise DeviceError(
                client.name(axis.device),
                f"it lost its turn count and stands {math.degrees(off_rad):+.0f} deg from where "
                f"{expected.reason} ({math.degrees(expected.angle_rad):.0f} deg); "
                f"limit {math.degrees(expected.tolerance_rad):.0f} deg",
                "bring it there by hand, or run `contid home`",
            )
    store(client, axis, turns)
    axis.seen = axis.to_rad(position)


def _displacement(client: ServoClient, axis: Axis) -> str:
    """Which setting makes the position another one than the count of the encoder, "" for none."""
    first, last = reg.DRIVE_MODE, reg.HOMING_OFFSET
    block = client.read_block(axis.device, first.address, last.address + last.size - first.address)
    offset = last.decode(block[-last.size :])
    found = [f"{last.name} is {offset}"] if offset else []
    found += [f"{first.name} is {block[0]} (reverse)"] if block[0] & _REVERSE else []
    return " and ".join(found)


def _count_from_encoder(client: ServoClient, axis: Axis, displaced: str) -> None:
    """Make the position the count of the encoder.

    Raises:
        DeviceError: torque is on, which locks the two settings.
    """
    name = client.name(axis.device)
    if client.read(axis.device, reg.TORQUE_ENABLE):
        remedy = "support the robot and relax it, then clear-fault"
        raise DeviceError(name, f"{displaced}, the robot file requires 0, and torque is on", remedy)
    log.warning("%s: %s, set by another program; 0 now", name, displaced)
    for register in (reg.DRIVE_MODE, reg.HOMING_OFFSET):
        if client.read(axis.device, register):
            client.write(axis.device, register, 0)


class _Expected(NamedTuple):
    """Where an axis should stand [rad], how far it may be from there [rad], and why it should."""

    angle_rad: float
    tolerance_rad: float
    reason: str


def _expected(client: ServoClient, axis: Axis) -> _Expected | None:
    """Where a servo without a valid count should stand, by the table above; None where nothing is known.

    Raises:
        DeviceError: it has to be homed.
    """
    if axis.seen is not None:
        return _Expected(axis.seen, SEEN_TOLERANCE_RAD, "it was last seen at")
    name, homing, remedy = client.name(axis.device), axis.options.homing, "run `contid home`"
    if _has_address(client, axis):
        if homing is None:
            remedy = "bring it to its first turn by hand and switch its power off and on, or configure homing"
        raise DeviceError(
            name, "another program reset its count of turns (operating mode, homing offset)", remedy
        )
    match homing:
        case SingleTurn(pose_deg=pose_deg, plausible_deg=plausible_deg):
            return _Expected(math.radians(pose_deg), math.radians(plausible_deg), "it is parked at")
        case HardStop() | Tensioning():
            raise DeviceError(name, "it has lost its turn count (power was off) and is not homed", remedy)
    log.warning("%s was power-cycled and has no homing; its turn count is used unchecked", name)
    return None


def _has_address(client: ServoClient, axis: Axis) -> bool:
    """Whether the last Indirect Address holds turns: the servo was not powered up since they were stored."""
    try:
        return abs(client.read(axis.device, LAST_ADDRESS) - _ADDRESS_ZERO) <= TURNS_MAX
    except ServoRefusedError:
        return False


def _nearest(position: int, angle_rad: float) -> int:
    """The turns that bring a position [ticks] nearest to an angle."""
    return round((angle_rad - position * reg.RAD_PER_TICK) / math.tau)


def _offset(position: int, angle_rad: float) -> float:
    """How far from an angle the nearest turns bring a position [ticks], in rad."""
    return math.remainder(position * reg.RAD_PER_TICK - angle_rad, math.tau)
