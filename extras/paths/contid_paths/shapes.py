"""Shapes to follow, as points by time, for ``contid path``.

Every shape is a function of ``tau``, the number of laps, one per period. Plane coordinates (x, y) are about
the shape's centre, z is added to the height; lengths in mm. Open shapes return on the same path.

Source: the trajectories of Shi et al. (Fig. 7: square, ellipse, spiral, box with variable height), Hughes et
al. (Fig. 5: traverse, diagonal, corners) and Morita et al. (section V: circle, line). The papers print no
formulae; these follow the captions of the figures.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Iterator
from dataclasses import dataclass

from contid.errors import ContidError
from contid.targets import Vec3
from contid.trajectory.rows import MAX_ROWS


class Shape(enum.StrEnum):
    """Kinds of shape."""

    LINE = "line"
    CIRCLE = "circle"
    ELLIPSE = "ellipse"
    SQUARE = "square"
    BOX = "box"
    SPIRAL = "spiral"
    CORNERS = "corners"
    TRAVERSE = "traverse"
    DIAGONAL = "diagonal"

    @property
    def is_round(self) -> bool:
        """True when its size is given by a radius."""
        return self in (Shape.CIRCLE, Shape.ELLIPSE, Shape.SPIRAL)

    @property
    def can_lean(self) -> bool:
        """True when "outward" is defined: it does not pass through its centre."""
        return self not in (Shape.LINE, Shape.TRAVERSE, Shape.DIAGONAL)


def check_row_count(period_s: float, laps: float, rate_hz: float) -> None:
    """Refuse more rows than a trajectory may have.

    Raises:
        ContidError: with their number.
    """
    rows = laps * period_s * rate_hz
    if not rows <= MAX_ROWS:
        raise ContidError(
            f"{laps:g} laps of {period_s:g} s at {rate_hz:g} Hz make {rows:.3g} rows; "
            f"allowed are {MAX_ROWS}: lower the rate"
        )


# Corners in the order of the square and of the visit of Hughes et al., in units of half the side.
_SQUARE = ((1.0, -1.0), (1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0))
_CORNERS = ((1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0))


@dataclass(frozen=True, slots=True)
class ShapePath:
    """A shape with its numbers.

    Attributes:
        shape: which one.
        center_mm: of the shape, in the world.
        size_mm: side of squares, length of lines, maximum diameter of round shapes.
        height_mm: z of the shape, or of its lowest point when ``dz_mm`` is positive.
        dz_mm: variation of the height.
        turns: of the spiral.
        ratio: second semi-axis of the ellipse by its first.
        angle_deg: rotation of the shape about its centre.
        lean_deg: tilt of the direction outward from +z, in the radial plane of the point; None without one.
        roll_deg: turn of the tip's frame about that direction; None without a frame.
        period_s: time of one lap.
        laps: number of laps.
        rate_hz: rows per second.
    """

    shape: Shape
    center_mm: tuple[float, float]
    size_mm: float
    height_mm: float = 0.0
    dz_mm: float = 0.0
    turns: float = 3.0
    ratio: float = 2.0 / 3.0
    angle_deg: float = 0.0
    lean_deg: float | None = None
    roll_deg: float | None = None
    period_s: float = 4.0
    laps: float = 1.0
    rate_hz: float = 50.0

    def __post_init__(self) -> None:
        """Refuse numbers that are not positive, and a lean that is undefined."""
        for name in ("size_mm", "period_s", "laps", "rate_hz", "turns", "ratio"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) > 0.0):
                raise ContidError(f"{name} is {getattr(self, name)}; allowed are numbers greater than 0")
        check_row_count(self.period_s, self.laps, self.rate_hz)
        if self.lean_deg is not None and not self.shape.can_lean:
            raise ContidError(f"a {self.shape} passes its centre, where outward is undefined; it cannot lean")
        if self.roll_deg is not None and self.lean_deg is None:
            raise ContidError("a roll is about the tip's direction; give its lean too, 0 for +z")

    def times(self) -> Iterator[float]:
        """Times of the rows [s]: tick by rate, the last at or after the end of the laps."""
        last = math.ceil(self.laps * self.period_s * self.rate_hz - 1e-9)
        for tick in range(last + 1):
            yield tick / self.rate_hz

    def point_mm(self, time_s: float) -> Vec3:
        """Point of the shape at ``time_s`` [mm]; its end after the last lap."""
        x, y, rise = self._local(self._tau(time_s))
        cos, sin = _cos_sin_turns(self.angle_deg / 360.0)
        center_x, center_y = self.center_mm
        height = self.height_mm + self.dz_mm * rise
        return (center_x + cos * x - sin * y, center_y + sin * x + cos * y, height)

    def direction(self, time_s: float) -> Vec3:
        """The leaning direction ``R e_z`` with ``R = Rz(phi) Ry(lean) Rz(-phi)``, phi the point's azimuth."""
        assert self.lean_deg is not None
        x, y, _ = self._local(self._tau(time_s))
        lean = math.radians(self.lean_deg)
        azimuth = math.atan2(y, x) + math.radians(self.angle_deg)
        return (math.sin(lean) * math.cos(azimuth), math.sin(lean) * math.sin(azimuth), math.cos(lean))

    def x_axis(self, time_s: float) -> Vec3:
        """The tip's x axis ``R Rz(roll) e_x``, R as of `direction`; arms without torsion have roll 0."""
        assert self.lean_deg is not None
        assert self.roll_deg is not None
        x, y, _ = self._local(self._tau(time_s))
        lean, roll = math.radians(self.lean_deg), math.radians(self.roll_deg)
        azimuth = math.atan2(y, x) + math.radians(self.angle_deg)
        along, across = math.cos(roll - azimuth), math.sin(roll - azimuth)
        cos, sin = math.cos(azimuth), math.sin(azimuth)
        flat = along * math.cos(lean)
        return (cos * flat - sin * across, sin * flat + cos * across, -along * math.sin(lean))

    def _tau(self, time_s: float) -> float:
        return min(time_s / self.period_s, self.laps)

    def _local(self, tau: float) -> Vec3:
        """Offset from the centre before rotation [mm], and the factor (0..1) of ``dz_mm``."""
        half = self.size_mm / 2.0
        cos, sin = _cos_sin_turns(tau)
        wave = (1.0 - cos) / 2.0
        match self.shape:
            case Shape.LINE:
                return (half * cos, 0.0, wave)
            case Shape.CIRCLE:
                return (half * cos, half * sin, wave)
            case Shape.ELLIPSE:
                return (half * cos, half * self.ratio * sin, wave)
            case Shape.SQUARE | Shape.BOX:
                x, y = _polygon(_SQUARE, tau % 1.0)
                return (half * x, half * y, wave)
            case Shape.CORNERS:
                x, y = _polygon(_CORNERS, tau % 1.0, rest=True)
                return (half * x, half * y, wave)
            case Shape.SPIRAL:
                out = _there_and_back(tau)
                cos, sin = _cos_sin_turns(self.turns * out)
                return (half * out * cos, half * out * sin, out)
            case Shape.TRAVERSE:
                return (half * (2.0 * minimum_jerk(_there_and_back(tau)) - 1.0), 0.0, 0.0)
            case Shape.DIAGONAL:
                out = minimum_jerk(_there_and_back(tau))
                return (half * (2.0 * out - 1.0), half * (2.0 * out - 1.0), out)


def _polygon(corners: tuple[tuple[float, float], ...], tau: float, rest: bool = False) -> tuple[float, float]:
    """The point at ``tau`` in [0, 1) of a lap through the corners, at constant speed or rest to rest."""
    edge = math.floor(tau * len(corners))
    part = tau * len(corners) - edge
    part = minimum_jerk(part) if rest else part
    (x0, y0), (x1, y1) = corners[edge % len(corners)], corners[(edge + 1) % len(corners)]
    return (x0 + part * (x1 - x0), y0 + part * (y1 - y0))


def minimum_jerk(part: float) -> float:
    """Minimum-jerk polynomial from 0 to 1: ``10 p^3 - 15 p^4 + 6 p^5`` (Flash and Hogan 1985)."""
    return part**3 * (10.0 + part * (-15.0 + 6.0 * part))


def _there_and_back(tau: float) -> float:
    """0 to 1 in odd laps, 1 to 0 in even ones."""
    within = tau % 2.0
    return within if within <= 1.0 else 2.0 - within


def _cos_sin_turns(turns: float) -> tuple[float, float]:
    """Cosine and sine of whole turns, exact at the quarters, so that shapes close exactly."""
    part = turns % 1.0
    quarter = {0.0: (1.0, 0.0), 0.25: (0.0, 1.0), 0.5: (-1.0, 0.0), 0.75: (0.0, -1.0)}
    angle = 2.0 * math.pi * part
    return quarter.get(part, (math.cos(angle), math.sin(angle)))
