"""The meaning of one column of a robot."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Meaning:
    """One quantity of a robot: its group, its place in the group, and ``si = value * factor / divisor``.

    Two numbers for one scale: 70 / 1000 is the nearest double to 0.07, 70 * 0.001 is not.
    """

    group: str
    place: int
    factor: float = 1.0
    divisor: float = 1.0
