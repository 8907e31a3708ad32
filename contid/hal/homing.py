"""What a reference must prove before it counts as found; the same for the axes of every driver.

A frozen encoder and a jammed shaft stand still like a stop. So every search stops, backs off, must have moved
back by the back-off, comes again and must find the same place. A place that disagrees with the zero of the
robot file is refused as well, unless the file's zero is given up (``contid home --force``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from contid.errors import DeviceError

#: Greatest distance of two findings of one stop.
REPEAT_RAD: Final = math.radians(1.0)
#: Greatest share of the back-off that friction may keep from it, with the low current of a search.
WAY_SHARE: Final = 0.4
#: The same for tendons, which give [m].
REPEAT_TENDON_M: Final = 0.002
#: A shorter way back would drown in noise.
BACKOFF_MIN_DEG: Final = 3.0
_TURN: Final = 2.0 * math.pi


@dataclass(frozen=True, slots=True)
class Reference:
    """What is known about the reference of an axis before it is searched.

    Attributes:
        zero_rad: device value at length 0 by the robot file [rad]; None without ``zero_deg``, and when it is
            given up.
        way_rad: device value at the reference, less that [rad].
        repeat_rad: greatest distance of two findings [rad].
        mm_per_rad: length of the actuator per angle of the device, None where its column is an angle.
    """

    zero_rad: float | None = None
    way_rad: float = 0.0
    repeat_rad: float = REPEAT_RAD
    mm_per_rad: float | None = None

    def written(self, angle_rad: float) -> str:
        """An angle of the device as a person measures it: in mm where the axis has a length."""
        text = f"{math.degrees(angle_rad):.2f} deg"
        if self.mm_per_rad is None:
            return text
        return f"{self.mm_per_rad * angle_rad:.2f} mm ({text})"

    def require_way_back(self, device: str, moved_rad: float, backoff_rad: float) -> None:
        """Refuse a shaft that did not move back from the place where it stood still.

        One that fails on the way is found by the repetition.

        Args:
            device: names the axis in the error.
            moved_rad: way back that was measured, positive away from the reference [rad].
            backoff_rad: way back that was demanded [rad].

        Raises:
            DeviceError: it is jammed, or its encoder is dead.
        """
        if abs(moved_rad - backoff_rad) > max(REPEAT_RAD, WAY_SHARE * backoff_rad):
            raise DeviceError(
                device,
                f"it stands still, but does not move back: {math.degrees(moved_rad):.2f} of "
                f"{math.degrees(backoff_rad):.2f} deg; that is no stop but a jammed shaft or a dead encoder",
                "turn the shaft by hand: it must move, and `contid servo` or `contid doctor` must show it",
            )

    def require_repetition(self, device: str, first_rad: float, again_rad: float) -> None:
        """Refuse a reference that was found at two places.

        Raises:
            DeviceError: something blocked the way once, or the encoder slips.
        """
        off = again_rad - first_rad
        if abs(off) > self.repeat_rad:
            raise DeviceError(
                device,
                f"it stood still at two places, {self.written(off)} apart (allowed "
                f"{math.degrees(self.repeat_rad):.2f} deg): an obstacle, or a shaft or an encoder that slips",
                "clear its way, check couplings and encoder, then home again",
            )

    def require_former(self, device: str, found_rad: float, *, turns_lost: bool) -> None:
        """Refuse a reference elsewhere than by the zero of the robot file.

        Args:
            device: names the axis in the error.
            found_rad: device value at the reference [rad].
            turns_lost: the device has lost its count of whole turns since.

        Raises:
            DeviceError: an obstacle stands in the way, or the zero moved.
        """
        if self.zero_rad is None:
            return
        off = found_rad - self.way_rad - self.zero_rad
        if turns_lost:
            off = math.remainder(off, _TURN)
        if abs(off) > self.repeat_rad:
            whole = " (and whole turns)" if turns_lost else ""
            raise DeviceError(
                device,
                f"its zero moved by {self.written(off)}{whole}: old {self.written(self.zero_rad)}, new "
                f"{self.written(self.zero_rad + off)}; nothing is written",
                "look for what blocks its way; if it was rebuilt, `contid home --force` takes the new zero",
            )


#: Of an axis without a zero: `Reference.require_former` accepts whatever is found.
UNKNOWN: Final = Reference()
