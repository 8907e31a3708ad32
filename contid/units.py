"""Conversions between SI, which is used everywhere inside, and the units users write at the edges.

A quantity at the edge carries its unit as a suffix of its key (``length_mm``, ``p1_bar``). This module is
the one table of those suffixes.
"""

from __future__ import annotations

import math
from typing import Final

#: Suffix of a key at the edge -> factor that turns a number written with it into SI.
TO_SI: Final[dict[str, float]] = {
    "mm": 1e-3,
    "cm": 1e-2,
    "m": 1.0,
    "bar": 1e5,
    "pa": 1.0,
    "deg": math.pi / 180.0,
    "rad": 1.0,
    "s": 1.0,
    "ms": 1e-3,
    "hz": 1.0,
    "n": 1.0,
    "nm": 1.0,
    "g": 1e-3,
    "kg": 1.0,
    "ma": 1e-3,
    "a": 1.0,
    "v": 1.0,
    "per_mm": 1e3,
    "mm_s": 1e-3,
    "mm_s2": 1e-3,
    "mm_s3": 1e-3,
    "bar_s": 1e5,
    "bar_s2": 1e5,
    "bar_s3": 1e5,
}

MM: Final = 1e-3
BAR: Final = 1e5
DEG: Final = math.pi / 180.0

# Metres from millimetres by division: 70 / 1000 is the nearest double to 0.07, 70 * 1e-3 is not.
MM_PER_M: Final = 1e3


def mm_to_m(value_mm: float) -> float:
    """Millimetres to metres, correctly rounded."""
    return value_mm / MM_PER_M


def m_to_mm(value_m: float) -> float:
    """Metres to millimetres."""
    return value_m * MM_PER_M
