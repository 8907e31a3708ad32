"""Colours of drawings: robots, axes and what is around them."""

from __future__ import annotations

from typing import Final

Colour = tuple[int, int, int]
#: One pair per robot: first section, second section.
SECTIONS: Final[tuple[tuple[Colour, Colour], ...]] = (
    ((64, 156, 255), (134, 205, 255)),
    ((255, 150, 50), (255, 200, 120)),
    ((110, 205, 110), (175, 235, 165)),
    ((205, 130, 255), (230, 190, 255)),
)
#: One per axis: its curve and its bar.
CURVES: Final[tuple[Colour, ...]] = (
    (64, 156, 255), (255, 120, 90), (110, 205, 110), (205, 130, 255), (240, 200, 60), (70, 210, 210),
    (255, 150, 200), (150, 150, 255), (190, 160, 120),
)  # fmt: skip
#: Platforms, discs and links of bodies.
PLATE: Final[Colour] = (84, 92, 102)
MEASURED: Final[Colour] = (190, 190, 190)
TRACKED: Final[Colour] = (70, 225, 200)
EDGES: Final[Colour] = (120, 130, 140)
TARGET: Final[Colour] = (255, 70, 90)
TRAIL: Final[Colour] = (255, 214, 64)
REACH: Final[Colour] = (75, 85, 95)
FLOOR: Final[Colour] = (48, 52, 57)
OBSTACLE: Final[Colour] = (150, 112, 96)
COMPLIANCE: Final[Colour] = (120, 170, 150)
LOAD: Final[Colour] = (235, 120, 150)
ROPE: Final[Colour] = (215, 175, 125)
TRACK: Final[Colour] = (44, 48, 54)
TEXT: Final[Colour] = (150, 158, 166)
AXES: Final[tuple[Colour, ...]] = ((230, 70, 70), (80, 200, 90), (80, 120, 255))


def of_robot(number: int) -> tuple[Colour, Colour]:
    """Colours of the sections of a robot, by its number in the file."""
    return SECTIONS[number % len(SECTIONS)]


def of_axis(number: int) -> Colour:
    """Colour of an axis, by its number in the robot."""
    return CURVES[number % len(CURVES)]
