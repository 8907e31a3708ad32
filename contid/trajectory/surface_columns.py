"""Columns ``x_mm, y_mm`` alone, of an arm whose tip stays on a surface: one section that keeps its length.

The height follows from where the arm can be. In the base frame, with the arc of length L and the tip a rigid
length t behind it, a bend theta brings the tip to the distance

    rho(theta) = L (1 - cos theta) / theta + t sin theta

from the axis, towards the azimuth of the bend. It grows up to some bend beyond 90 degrees; up to there a pair
x, y has one shape, and rows become components of the bend as `contid.trajectory.arc_columns` has them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Final

from contid.robot_file.robot import RobotDescription, TipSurface

#: Places of x and y among the coordinates of a tip.
PLACES: Final = frozenset({0, 1})
#: Cosine of the angle between the base's z axis and the world's above which they count as parallel.
_PARALLEL: Final = 1.0 - 1e-9
_NEWTON: Final = 60
_ROUNDING: Final = 1e-12


class BesideSurfaceError(ValueError):
    """No bend of the section has a tip so far from its axis."""


@dataclass(frozen=True, slots=True)
class SurfaceColumns:
    """Indices in a row of the coordinates that bend the only section of a robot.

    Attributes:
        x, y: indices of the coordinates in the world.
        surface: lengths of the section.
        most_rad: bend at which the tip is farthest from the axis.
        rotation: from the base to the world, row by row; its z axis is vertical.
        origin_m: of the base in the world [m].
        length: no column has the length.
    """

    x: int
    y: int
    surface: TipSurface
    most_rad: float
    rotation: tuple[float, ...]
    origin_m: tuple[float, float, float]
    length: ClassVar[None] = None

    @property
    def moving(self) -> tuple[int, int]:
        """Indices of its columns."""
        return (self.x, self.y)

    def resolve(self, row: list[float]) -> None:
        """Replace x and y [m] in a row by the components of the bend [rad].

        Raises:
            BesideSurfaceError: no bend has a tip so far from the axis.
        """
        r = self.rotation
        x, y = row[self.x] - self.origin_m[0], row[self.y] - self.origin_m[1]
        x, y = r[0] * x + r[3] * y, r[1] * x + r[4] * y
        distance = math.hypot(x, y)
        bend = bend_of(self.surface, distance, self.most_rad)
        share = bend / distance if distance > 0.0 else 0.0
        row[self.x], row[self.y] = share * x, share * y

    def restore(self, row: list[float]) -> None:
        """Undo `resolve`."""
        u, v = row[self.x], row[self.y]
        bend = math.hypot(u, v)
        share = distance_of(self.surface, bend) / bend if bend > 0.0 else 0.0
        x, y, r = share * u, share * v, self.rotation
        row[self.x] = r[0] * x + r[1] * y + self.origin_m[0]
        row[self.y] = r[3] * x + r[4] * y + self.origin_m[1]

    def arc(self, row: Sequence[float]) -> tuple[float, float, float]:
        """Components of the bend [rad] and length [m] in a resolved row."""
        return row[self.x], row[self.y], self.surface.length_m


def distance_of(surface: TipSurface, bend: float) -> float:
    """Distance of the tip from the axis [m] at a bend [rad]."""
    half = 0.5 * bend
    sinc = math.sin(half) / half if half else 1.0
    return surface.length_m * sinc * math.sin(half) + surface.behind_m * math.sin(bend)


def bend_of(surface: TipSurface, distance_m: float, most_rad: float) -> float:
    """The least bend [rad] that brings the tip to a distance from the axis; ``most_rad`` is `farthest_bend`.

    Raises:
        BesideSurfaceError: there is none.
    """
    low, high = 0.0, most_rad
    most_m = distance_of(surface, high)
    if distance_m > most_m:
        if distance_m > most_m * (1.0 + _ROUNDING):
            raise BesideSurfaceError(
                f"the tip is {1e3 * distance_m:.4g} mm beside the axis, and no bend of the section brings it "
                f"farther than {1e3 * most_m:.4g} mm"
            )
        return high
    bend = distance_m / (0.5 * surface.length_m + surface.behind_m)
    for _ in range(_NEWTON):
        off = distance_of(surface, bend) - distance_m
        low, high = (low, bend) if off > 0.0 else (bend, high)
        slope = _slope(surface, bend)
        step = off / slope if slope > 0.0 else math.inf
        following = bend - step if low < bend - step < high else 0.5 * (low + high)
        if abs(following - bend) <= _ROUNDING * (1.0 + bend):
            return following
        bend = following
    return bend


def is_on_surface(robot: RobotDescription, places: set[int]) -> bool:
    """True where these coordinates of a tip are x and y, and the robot takes them alone."""
    return places == PLACES and robot.tip_surface is not None and _stands(robot)


def surface_columns(robot: RobotDescription, x: int, y: int) -> SurfaceColumns:
    """The columns of a robot that takes x and y alone (`is_on_surface`)."""
    assert robot.tip_surface is not None
    surface, base = robot.tip_surface, robot.base
    return SurfaceColumns(x, y, surface, farthest_bend(surface), base.rotation, base.position_m)


def _stands(robot: RobotDescription) -> bool:
    return abs(robot.base.rotation[8]) >= _PARALLEL


def _slope(surface: TipSurface, bend: float) -> float:
    """Derivative of `distance_of` by the bend [m/rad]."""
    if bend < 1e-4:
        return 0.5 * surface.length_m * (1.0 - 0.25 * bend * bend) + surface.behind_m * math.cos(bend)
    arc = (math.sin(bend) * bend - 1.0 + math.cos(bend)) / (bend * bend)
    return surface.length_m * arc + surface.behind_m * math.cos(bend)


def farthest_bend(surface: TipSurface) -> float:
    """The bend at which the tip is farthest from the axis [rad]: 133 degrees without a rigid tip."""
    low, high = 0.5 * math.pi, math.pi
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _slope(surface, middle) > 0.0 else (low, middle)
    return low
