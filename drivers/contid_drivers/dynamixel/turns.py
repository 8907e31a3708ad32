"""The turn of a servo, which it loses at power-off; a wrong turn is a wrong length of a rack.

The turns to add to the servo's count are stored in the servo's RAM, so that both are lost together: in the
last Indirect Address (default 227: turn unknown since power-up; 145 + n: n turns to add).

* An axis that homes against a hard stop is refused until it was homed.
* An axis with a stored pose takes the turn nearest to it, if it is near enough.
* The count of an axis without homing is used unchecked.
* A servo that reset while the host was connected takes the turn nearest to its last position.
"""

from __future__ import annotations

import logging
import math
from typing import Final

from contid.errors import DeviceError
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.axis import Axis
from contid_drivers.dynamixel.client import ServoClient
from contid_drivers.dynamixel.options import HardStop, SingleTurn

log = logging.getLogger(__name__)

MARKER: Final = next(r for r in reg.TABLE if r.name == f"indirect address {reg.INDIRECT_COUNT}")
_CENTRE: Final = 145
TURNS_MAX: Final = 80
#: Largest motion assumed during a reset of the servo.
SEEN_TOLERANCE_RAD: Final = math.radians(45.0)
_TURN: Final = 2.0 * math.pi


def recall(client: ServoClient, axis: Axis) -> bool:
    """Read the turns stored in the servo; False when it has none since power-up."""
    stored = client.read(axis.device, MARKER)
    if stored == MARKER.default:
        return False
    axis.turns = stored - _CENTRE
    return True


def store(client: ServoClient, axis: Axis, turns: int) -> None:
    """Store the turns in the servo, for as long as it is powered.

    Raises:
        DeviceError: too many turns.
    """
    if abs(turns) > TURNS_MAX:
        raise DeviceError(client.name(axis.device), f"{turns} turns from its zero; {TURNS_MAX} can be kept")
    client.write(axis.device, MARKER, _CENTRE + turns)
    axis.turns = turns


def settle(client: ServoClient, axis: Axis) -> None:
    """Determine the turn before the axis may move.

    Raises:
        DeviceError: it cannot be inferred.
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
        log.warning("%s was power-cycled and has no homing; its turn count is used unchecked", name)
        store(client, axis, 0)
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
