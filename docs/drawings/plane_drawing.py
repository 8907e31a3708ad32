"""A drawing of a plane of the world: lines, frames and dimensions in mm become an SVG in pixels."""

from __future__ import annotations

from typing import Any

import numpy as np

from docs.drawings.svg import Point, Svg

BODY, AXIS, FRAME, SIZE = "#1b4965", "#ca6702", "#9b2226", "#6c757d"


class Drawing(Svg):
    """A plane of the world in pixels: ``scale`` pixels per mm, ``v`` up, or down for hanging robots."""

    def __init__(self, title: str, width: int, height: int) -> None:
        super().__init__(title, width, height, {"frame": FRAME, "size": SIZE})
        self.note((16, 22), title, bold=True)
        self.view((0, 0), 1.0)

    def view(self, origin_px: Point, scale: float, up: bool = True) -> None:
        """Place the origin of the plane; what follows is in mm of it."""
        self._origin, self._scale, self._sign = origin_px, scale, -1.0 if up else 1.0

    def px(self, point_mm: Any) -> Point:
        """Pixels of a point of the plane."""
        u, v = float(point_mm[0]), float(point_mm[1])
        return self._origin[0] + self._scale * u, self._origin[1] + self._sign * self._scale * v

    def label(
        self, at_mm: Any, text: str, colour: str = "black", shift: Point = (0, 0), anchor: str = "start"
    ) -> None:
        """A line of text beside a point of the plane."""
        x, y = self.px(at_mm)
        self.note((x + shift[0], y + shift[1]), text, colour, anchor=anchor)

    def line(
        self, points_mm: Any, colour: str = BODY, width: float = 2, dash: str = "", ends: str = ""
    ) -> None:
        """A line through points of the plane; ``ends`` names its arrow heads (``size``: both ends)."""
        heads = (ends, "size") if ends == "size" else (ends,) if ends else ()
        self.polyline([self.px(point) for point in points_mm], colour, width, dash, heads)

    def frame(self, at_mm: Any, u: Any, v: Any, names: tuple[str, str, str], length: float) -> None:
        """Two axes of a frame, and its name at the origin."""
        at = np.asarray(at_mm, float)
        for way, name in ((np.asarray(u), names[0]), (np.asarray(v), names[1])):
            end = at + length * way
            self.line([at, end], FRAME, 2, ends="frame")
            self.label(at + 1.16 * length * way, name, FRAME, shift=(0, 4), anchor="middle")
        self.label(at, names[2], FRAME, shift=(-8, 18), anchor="end")

    def size(self, a_mm: Any, b_mm: Any, text: str, shift: Point, anchor: str = "start") -> None:
        """A dimension between two points of the plane."""
        self.line([a_mm, b_mm], SIZE, 1, ends="size")
        self.label((np.asarray(a_mm) + np.asarray(b_mm)) / 2, text, SIZE, shift, anchor)

    def circle(self, at_mm: Any, radius_mm: float, colour: str = BODY, fill: str = "none") -> None:
        """A circle of the plane."""
        x, y = self.px(at_mm)
        self.add(
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{self._scale * radius_mm:.1f}" fill="{fill}" '
            f'stroke="{colour}"/>'
        )
