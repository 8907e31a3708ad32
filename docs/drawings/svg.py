"""An SVG drawing in pixels: its head, text and lines; the drawings of the docs are built on it."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from html import escape
from pathlib import Path

IMAGES = Path(__file__).parents[1] / "images"
Point = tuple[float, float]


class Svg:
    """A drawing on white; ``heads`` are the arrow heads by name, with their colours."""

    def __init__(self, title: str, width: int, height: int, heads: Mapping[str, str] | None = None) -> None:
        self._parts = [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" '
            f'height="{height}" font-family="sans-serif" font-size="12">',
            f"<title>{escape(title)}</title>",
            "<defs>"
            + "".join(
                f'<marker id="{name}" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="6" markerHeight="6" '
                f'orient="auto-start-reverse"><path d="M0,0 L8,4 L0,8 z" fill="{colour}"/></marker>'
                for name, colour in (heads or {}).items()
            )
            + "</defs>",
            f'<rect width="{width}" height="{height}" fill="white"/>',
        ]

    def add(self, element: str) -> None:
        """An element of SVG."""
        self._parts.append(element)

    def note(
        self, at_px: Point, text: str, colour: str = "black", bold: bool = False, anchor: str = "start"
    ) -> None:
        """A line of text."""
        weight = ' font-weight="bold"' if bold else ""
        self.add(
            f'<text x="{at_px[0]:.1f}" y="{at_px[1]:.1f}" fill="{colour}" text-anchor="{anchor}"{weight}>'
            f"{escape(text)}</text>"
        )

    def polyline(
        self, points_px: Sequence[Point], colour: str, width: float, dash: str = "", ends: Sequence[str] = ()
    ) -> None:
        """A line; ``ends`` names the arrow heads of its last and of its first point."""
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points_px)
        extra = f' stroke-dasharray="{dash}"' if dash else ""
        for place, name in zip(("end", "start"), ends, strict=False):
            extra += f' marker-{place}="url(#{name})"'
        self.add(f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="{width}"{extra}/>')

    def svg(self) -> str:
        """The whole drawing."""
        return "\n".join([*self._parts, "</svg>"]) + "\n"


def write_drawings(drawings: Mapping[str, Callable[[], Svg]]) -> None:
    """Write drawings into docs/images, by the names of their files."""
    for name, draw in drawings.items():
        (IMAGES / name).write_text(draw().svg(), encoding="utf-8")
        sys.stderr.write(f"{IMAGES / name}\n")
