"""The turn of a servo, which it loses at power-off; a wrong turn is a wrong length of a rack.

The turns to add to the servo's count are kept in two registers of the servo's RAM, so that they are lost with
the count: in Velocity I Gain, unused in the position modes (4096 + n: n turns), and in the last Indirect
Address (145 + n; default 227: none since power-up), where the servo has one. A power-off clears both. A
change of operating mode clears the gain, and through position mode the servo loses its count without a
power-off (e-manual, register 132).

* The gain in a mode of several turns: the count is valid.
* No mark: the servo was powered up. An axis that homes against a hard stop is refused until it was homed; an
  axis with a stored pose takes the turn nearest to it, if it is near enough; the count of an axis without
  homing is used unchecked.
* The address alone: another program reset the count in the middle of the travel; the axis is refused.
* A servo that reset while the host was connected takes the turn nearest to its last position.

Not detectable: a CLEAR sent by another program while contid does not run.
"""

from __future__ import annotations

import logging
import math
from typing import Final

from contid.errors import DeviceError
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.axis import FAR_RAD, Axis
from contid_drivers.dynamixel.client import TRIES, ServoClient, ServoRefusedError
from contid_drivers.dynamixel.options import HardStop, SingleTurn, Tensioning
from contid_drivers.dynamixel.packets import sync_write
from contid_drivers.dynamixel.registers import Register

log = logging.getLogger(__name__)

MARKER: Final = next(r for r in reg.TABLE if r.name == f"indirect address {reg.INDIRECT_COUNT}")
#: Values of the two registers for 0 turns.
_CENTRE: Final = 145
_GAIN_CENTRE: Final = 4096
_MULTI_TURN_MODES: Final = tuple(reg.MODE_NUMBERS.values())
#: Greatest number of turns that is stored.
TURNS_MAX: Final = 80
#: Greatest motion assumed between the last reading (``axis.seen``) and the first one after a reset.
SEEN_TOLERANCE_RAD: Final = FAR_RAD
_TURN: Final = 2.0 * math.pi
_NO_MARKS: Final = ((MARKER, MARKER.default), (reg.VELOCITY_I, reg.VELOCITY_I.default))


def counts_turns(client: ServoClient, axis: Axis) -> bool:
    """True in an operating mode that keeps the count of turns."""
    return client.read(axis.device, reg.OPERATING_MODE) in _MULTI_TURN_MODES


def store(client: ServoClient, axis: Axis, turns: int) -> None:
    """Store the turns in the servo, for as long as it is powered; in position mode on the host only.

    Raises:
        DeviceError: too many turns.
    """
    if abs(turns) > TURNS_MAX:
        raise DeviceError(client.name(axis.device), f"{turns} turns from its zero; {TURNS_MAX} can be kept")
    axis.turns, axis.turn_known, axis.marked = turns, True, False
    if counts_turns(client, axis):
        marker, gain = marks_of(turns)
        client.write(axis.device, *gain)
        axis.marked = True
        try:
            client.write(axis.device, *marker)
        except ServoRefusedError as error:
            log.info("%s: %s", client.name(axis.device), error.message)


def adopt(client: ServoClient, axis: Axis, position: int) -> None:
    """Keep the turn of a servo that reset, at the first position it reports; in a tick, so unconfirmed.

    Without a turn near enough to its last position the mark is cleared, so that `settle` refuses the axis.
    """
    if axis.seen is None:
        return
    raw = position * reg.RAD_PER_TICK
    turns = round((axis.seen - raw) / _TURN)
    near = abs(turns) <= TURNS_MAX and abs(raw + turns * _TURN - axis.seen) <= SEEN_TOLERANCE_RAD
    if near:
        axis.turns = turns
    axis.marked = near
    for register, value in marks_of(turns) if near else _NO_MARKS:
        data = register.encode(value)
        client.port.send(sync_write(register.address, register.size, [(axis.device, data)]))


def marks_of(turns: int) -> tuple[tuple[Register, int], ...]:
    """The two registers that keep the turns, and their values; no model has such a gain by default."""
    return (MARKER, _CENTRE + turns), (reg.VELOCITY_I, _GAIN_CENTRE + turns)


def forget(client: ServoClient, axis: Axis) -> None:
    """Clear the marks, as a power-up does; used after the axis was parked by hand."""
    axis.seen = None
    for register, value in _NO_MARKS:
        try:
            client.write(axis.device, register, value)
        except ServoRefusedError as error:
            log.info("%s: %s", client.name(axis.device), error.message)


def kept(client: ServoClient, axis: Axis) -> int | None:
    """The turns that the servo keeps; None when its count is not valid."""
    stored = client.read(axis.device, reg.VELOCITY_I) - _GAIN_CENTRE
    return stored if abs(stored) <= TURNS_MAX and counts_turns(client, axis) else None


def reset_since(client: ServoClient, axis: Axis, tries: int = TRIES) -> bool:
    """Whether a servo has lost the mark of its turn.

    Raises:
        NoAnswerError: it is silent.
    """
    gain = reg.VELOCITY_I
    data = client.read_block(axis.device, gain.address, gain.size, tries)
    return gain.decode(data) != _GAIN_CENTRE + axis.turns


def require_kept(client: ServoClient, axis: Axis) -> None:
    """Refuse to arm a servo whose count is not the one that `settle` has found.

    Raises:
        DeviceError: it reset itself, or another program reset its count; or its turn cannot be inferred.
    """
    if not axis.marked:
        # In position mode nothing kept its turn.
        settle(client, axis)
    elif kept(client, axis) != axis.turns:
        axis.latch_reset()
        raise DeviceError(client.name(axis.device), axis.fault, "clear-fault, once it is safe to move")


def settle(client: ServoClient, axis: Axis) -> None:
    """Determine the turn before the axis may move.

    Raises:
        DeviceError: it cannot be inferred.
    """
    axis.turn_known = axis.marked = False
    device = axis.device
    stored = kept(client, axis)
    if stored is not None:
        axis.turns, axis.turn_known, axis.marked = stored, True, True
        axis.seen = axis.to_rad(client.read(device, reg.PRESENT_POSITION))
        return
    # The value after a power-up, 227 or 243 by model, is beyond the turns that are kept.
    marked = abs(_read_marker(client, device) - _CENTRE) <= TURNS_MAX
    name, homing = client.name(device), axis.options.homing
    raw = client.read(device, reg.PRESENT_POSITION) * reg.RAD_PER_TICK
    if axis.seen is not None:
        expected, tolerance, what = axis.seen, SEEN_TOLERANCE_RAD, "it was last seen at"
    elif marked:
        raise DeviceError(name, "another program reset its count of turns (operating mode)", _remedy(axis))
    elif isinstance(homing, SingleTurn):
        expected = math.radians(homing.pose_deg)
        tolerance, what = math.radians(homing.plausible_deg), "it is parked at"
    elif isinstance(homing, HardStop | Tensioning):
        raise DeviceError(
            name, "it has lost its turn count (power was off) and is not homed", "run `contid home`"
        )
    else:
        log.warning("%s was power-cycled and has no homing; its turn count is used unchecked", name)
        store(client, axis, 0)
        axis.seen = axis.to_rad(round(raw / reg.RAD_PER_TICK))
        return
    turns = round((expected - raw) / _TURN)
    off = raw + turns * _TURN - expected
    if abs(off) > tolerance:
        raise DeviceError(
            name,
            f"it lost its turn count and stands {math.degrees(off):+.0f} deg from where {what} "
            f"({math.degrees(expected):.0f} deg); limit {math.degrees(tolerance):.0f} deg",
            "bring it there by hand, or run `contid home`",
        )
    store(client, axis, turns)
    axis.seen = raw + turns * _TURN


def _read_marker(client: ServoClient, device: int) -> int:
    """The last Indirect Address; its default in a servo that has none."""
    try:
        return client.read(device, MARKER)
    except ServoRefusedError:
        return MARKER.default


def _remedy(axis: Axis) -> str:
    if axis.options.homing is None:
        return "bring it to its first turn by hand and switch its power off and on, or configure homing"
    return "run `contid home`"
