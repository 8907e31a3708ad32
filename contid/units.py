"""Units of files and messages, their conversion to SI (used everywhere inside contid); the longest line."""

from __future__ import annotations

import math
from typing import Final

#: Longest line of text that contid reads [characters or bytes]: rows of trajectories, requests and responses
#: on a socket. A row of sixteen fingers has about a thousand characters.
MAX_LINE: Final = 1 << 16

#: Pascals in a bar, radians in a degree.
BAR: Final = 1e5
DEG: Final = math.pi / 180.0
#: Standard acceleration of gravity (3rd General Conference on Weights and Measures, 1901) [m/s^2].
STANDARD_GRAVITY: Final = 9.80665

# Metres from millimetres by division: 70 / 1000 is the nearest double to 0.07, 70 * 1e-3 is not.
MM_PER_M: Final = 1e3

# Actuation that exceeds a limit by less than this counts as inside and is clamped: 1e-6 mm and 1e-9 bar, far
# below the resolution of any actuator, far above the rounding of a number that was printed and parsed.
LIMIT_TOLERANCE_M: Final = 1e-9
LIMIT_TOLERANCE_PA: Final = 1e-4


def mm_to_m(value_mm: float) -> float:
    """Millimetres to metres, correctly rounded."""
    return value_mm / MM_PER_M


def m_to_mm(value_m: float) -> float:
    """Metres to millimetres."""
    return value_m * MM_PER_M
