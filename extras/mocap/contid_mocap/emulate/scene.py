"""What an emulated room sees: bodies that move on a circle, or poses from lines on stdin."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from typing import Final

from contid.errors import ContidError

#: Largest number in a pose; packets have single precision, which ends at 3e38.
MAX_NUMBER: Final = 1e10
#: Position [m] and quaternion (x, y, z, w).
EmulatedPose = tuple[float, float, float, float, float, float, float]


@dataclass(slots=True)
class EmulatedScene:
    """Bodies by name; each has three markers around its origin.

    Attributes:
        bodies: poses; None of one that is hidden.
        moving: bodies that move on a circle by themselves.
    """

    bodies: dict[str, EmulatedPose | None] = field(default_factory=dict)
    moving: bool = True

    def at(self, time_s: float) -> dict[str, EmulatedPose | None]:
        """The poses at a time; without lines on stdin, circles of 20 mm in 4 s."""
        if not self.moving:
            return dict(self.bodies)
        a = 0.5 * math.pi * time_s
        found: dict[str, EmulatedPose | None] = {}
        for name, pose in self.bodies.items():
            if pose is None:
                found[name] = None
            else:
                x, y, z, *turn = pose
                moved = (x + 0.02 * math.cos(a), y + 0.02 * math.sin(a), z, *turn)
                found[name] = moved  # type: ignore[assignment]
        return found

    def move(self, line: str) -> None:
        """Take a line ``{"NAME": [x, y, z, qx, qy, qz, qw], ...}``; null hides a body.

        Raises:
            ContidError: it is another line; no body has moved.
        """
        try:
            poses = {name: None if pose is None else _pose(pose) for name, pose in json.loads(line).items()}
        except (ValueError, TypeError, AttributeError, RecursionError) as error:
            message = 'a line {"NAME": [x, y, z, qx, qy, qz, qw]} with numbers, or null, is expected'
            raise ContidError(f"stdin: {line[:80]!r}: {message}") from error
        self.moving = False
        self.bodies |= poses


def _pose(values: object) -> EmulatedPose:
    """A pose from a value of JSON.

    Raises:
        ValueError: it is no list of seven numbers, which are finite and fit into the packets.
    """
    if not isinstance(values, list) or not all(map(_is_coordinate, values)):
        raise ValueError(f"{values!r:.80} is no pose")
    x, y, z, qx, qy, qz, qw = map(float, values)
    return x, y, z, qx, qy, qz, qw


def _is_coordinate(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= MAX_NUMBER
