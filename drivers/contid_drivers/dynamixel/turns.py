"""Which turn a servo is in: its count is lost at power-off, and a wrong turn is a wrong length of a rack.

The servo keeps its count while it is powered, so the host's part of it, whole turns to add, is kept where it
is lost together with it: in the servo's RAM, as the last Indirect Address (its default, 227, means that
nobody has found the turn since power-up; 145 + n means n turns to add).

* An axis that homes against a hard stop is refused until it was homed.
* An axis with a stored pose takes the turn nearest to it, if it stands near enough.
* An axis without homing is believed.
* A servo that reset while the host was connected takes the turn nearest to where it was last seen.
"""

from __future__ import annotations

import logging
import math
from typing import Final

from contid.errors import DeviceError
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.axis import Axis
from contid_drivers.dynamixel.options import HardStop, SingleTurn
from contid_drivers.dynamixel.protocol import ServoClient

log = logging.getLogger(__name__)

MARKER: Final = next(r for r in reg.TABLE if r.name == f"indirect address {reg.INDIRECT_COUNT}")
_CENTRE: Final = 145
TURNS_MAX: Final = 80
#: A servo that reset is believed to have moved less than this meanwhile.
SEEN_TOLERANCE_RAD: Final = math.radians(45.0)
_TURN: Final = 2.0 * math.pi


def recall(client: ServoClient, axis: Axis) -> bool:
    """Take the turns from the servo; False when nobody found them since it was powered up."""
    stored = client.read(axis.device, MARKER)
    if stored == MARKER.default:
        return False
    axis.turns = stored - _CENTRE
    return True


def store(client: ServoClient, axis: Axis, turns: int) -> None:
    """Remember the turns in the servo, for as long as it is powered.

    Raises:
        DeviceError: too many turns.
    """
    if abs(turns) > TURNS_MAX:
        raise DeviceError(client.name(axis.device), f"{turns} turns from its zero; {TURNS_MAX} can be kept")
    client.write(axis.device, MARKER, _CENTRE + turns)
    axis.turns = turns


def settle(client: ServoClient, axis: Axis) -> None:
    """Know the turn before the axis may move.

    Raises:
        DeviceError: it is not known and cannot be inferred; says what to do.
    """
    if recall(client, axis):
        return
    name, homing = client.name(axis.device), axis.options.homing
    raw = client.read(axis.device, reg.PRESENT_POSITION) * reg.RAD_PER_TICK
    if axis.value is not None:
        expected, tolerance, what = axis.value, SEEN_TOLERANCE_RAD, "it was last seen at"
    elif isinstance(homing, SingleTurn):
        expected = math.radians(homing.pose_deg)
        tolerance, what = math.radians(homing.plausible_deg), "it is parked at"
    elif isinstance(homing, HardStop):
        raise DeviceError(
            name, "it has lost its turn count (power was off) and is not homed", "run `contid home`"
        )
    else:
        log.warning("%s: powered up since, and it has no homing: its count of turns is believed", name)
        store(client, axis, 0)
        return
    turns = round((expected - raw) / _TURN)
    off = raw + turns * _TURN - expected
    if abs(off) > tolerance:
        raise DeviceError(
            name,
            f"it lost its turn count and stands {math.degrees(off):+.0f} deg from where {what} "
            f"({math.degrees(expected):.0f} deg); {math.degrees(tolerance):.0f} deg are believed",
            "bring it there by hand, or run `contid home`",
        )
    store(client, axis, turns)
