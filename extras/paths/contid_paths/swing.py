"""The two tips of a closed chain that swing a rope, as rows by time: ``contid path swing``.

Each tip follows an ellipse over its own base, in phase across the line between the bases and in antiphase
along it,

    ``tip = base + across cos(2 pi tau) n -+ along sin(2 pi tau) e``  at one height

with e the unit vector from the first base to the second, n horizontal and perpendicular to it. The rope is
quasi-static: it hangs as a catenary. (A fast skipping rope is a troposkein, which contid does not compute.)

Source: the video of Singh et al. (IROS 2018) shows such a swing without numbers; this form is contid's.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from contid.errors import ContidError
from contid.targets import Vec3
from contid.trajectory.columns import TIME
from contid_paths.shapes import Shape, ShapePath


@dataclass(frozen=True, slots=True)
class Swing:
    """A swing with its numbers.

    Attributes:
        arms: names of the two arms.
        bases_mm: their bases in the world.
        size_mm: travel of the tips across, end to end.
        ratio: travel along the line between the bases, divided by ``size_mm``.
        height_mm: of the tips in the world.
        period_s: time of one lap.
        laps: number of laps.
        rate_hz: rows per second.
    """

    arms: tuple[str, str]
    bases_mm: tuple[Vec3, Vec3]
    size_mm: float
    ratio: float
    height_mm: float
    period_s: float = 4.0
    laps: float = 1.0
    rate_hz: float = 50.0

    def path(self) -> ShapePath:
        """The first tip's ellipse about its base."""
        (x0, y0, _), (x1, y1, _) = self.bases_mm
        if math.hypot(x1 - x0, y1 - y0) == 0.0:
            raise ContidError(f"{self.arms[0]} and {self.arms[1]} have the same base; a swing needs two")
        # The long axis lies across: angle 0 of the ellipse is n.
        return ShapePath(
            Shape.ELLIPSE,
            (0.0, 0.0),
            self.size_mm,
            height_mm=self.height_mm,
            ratio=self.ratio,
            angle_deg=math.degrees(math.atan2(y1 - y0, x1 - x0)) + 90.0,
            period_s=self.period_s,
            laps=self.laps,
            rate_hz=self.rate_hz,
        )

    def columns(self) -> list[str]:
        """Columns of the rows."""
        return [TIME, *(f"{arm}.{axis}_mm" for arm in self.arms for axis in "xyz")]

    def rows(self) -> Iterator[tuple[float, ...]]:
        """Time [s] and the two tips in the world [mm]."""
        path = self.path()
        (x0, y0, _), (x1, y1, _) = self.bases_mm
        distance = math.hypot(x1 - x0, y1 - y0)
        ex, ey = (x1 - x0) / distance, (y1 - y0) / distance
        for time_s in path.times():
            x, y, z = path.point_mm(time_s)
            along = 2.0 * (x * ex + y * ey)
            yield time_s, x0 + x, y0 + y, z, x1 + x - along * ex, y1 + y - along * ey, z
