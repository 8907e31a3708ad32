"""Sections of a tendon robot in its file: backbone, tendons, and how far they may pull and bend."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from contid.robot_file.base import Azimuth, Interval, NonNegative, Size, Strict
from contid.units import MM_PER_M

#: The native kernel has scratch memory on the stack for this many sections.
MAX_TENDON_SECTIONS = 8
MAX_TENDONS = 8  # of a section


def tendon_arms(radius_m: Sequence[float], angle_rad: Sequence[float]) -> NDArray[np.float64]:
    """``d (cos sigma, sin sigma)`` of the tendons of a section [m], shape ``(tendons, 2)``."""
    radius, angle = np.array(radius_m), np.array(angle_rad)
    return np.stack((radius * np.cos(angle), radius * np.sin(angle)), axis=-1)


def pull_matrix(arms: Sequence[NDArray[np.float64]], *, through: bool) -> NDArray[np.float64]:
    """G, which turns bends into pulls [m/rad], shape ``(tendons, 2 sections)``.

    Args:
        arms: `tendon_arms` of every section [m].
        through: True when tendons run through the sections before their own.
    """
    matrix = np.zeros((sum(map(len, arms)), 2 * len(arms)))
    first = 0
    for j, own in enumerate(arms):
        for k in range(0 if through else j, j + 1):
            matrix[first : first + len(own), 2 * k : 2 * k + 2] = own
        first += len(own)
    return matrix


class TendonSectionDescription(Strict):
    """One section of the backbone and the tendons that end at its disc.

    Attributes:
        length_mm: length of the backbone between the discs; it does not change.
        radius_mm: distance of the tendons from the backbone, one number or one per tendon.
        angles_deg: azimuth of each tendon, counter-clockwise from +x seen from +z; three or more, all around,
            or with ``drives`` two that face each other.
        rigid_mm: rigid piece after the section, such as a thick disc.
    """

    length_mm: Size
    radius_mm: Annotated[tuple[Size, ...], Field(min_length=1, max_length=MAX_TENDONS)]
    angles_deg: Annotated[tuple[Azimuth, ...], Field(min_length=2, max_length=MAX_TENDONS)]
    rigid_mm: NonNegative = 0.0

    @model_validator(mode="after")
    def _check_angles(self) -> TendonSectionDescription:
        count = len(self.angles_deg)
        if len(self.radius_mm) not in (1, count):
            raise ValueError(
                f"radius_mm has {len(self.radius_mm)} numbers; allowed: 1 or {count}, one per tendon"
            )
        if count == 2:
            apart = abs(self.angles_deg[0] - self.angles_deg[1]) % 360.0
            if abs(apart - 180.0) > 1.0:
                raise ValueError(
                    f"angles_deg has two tendons {apart:g} degrees apart; allowed: 180, where they face each "
                    "other, or three or more tendons all around"
                )
            return self
        turned = sorted(angle % 360.0 for angle in self.angles_deg)
        widest = max(b - a for a, b in zip(turned, (*turned[1:], turned[0] + 360.0), strict=True))
        if widest > 170.0:
            raise ValueError(
                f"angles_deg leaves {widest:g} degrees without a tendon; allowed: gaps up to 170, "
                "so that the tendons can balance each other"
            )
        return self

    @property
    def radius_m(self) -> tuple[float, ...]:
        """Distance of every tendon from the backbone [m]."""
        count = len(self.angles_deg)
        return tuple(
            r / MM_PER_M for r in (self.radius_mm * count if len(self.radius_mm) == 1 else self.radius_mm)
        )


class TendonRobotGeometry(Strict):
    """Dimensions of the robot.

    Attributes:
        sections: sections from the base on.
        routing: ``through``: tendons run along the backbone through the sections before their own, and
            shorten with them; ``independent``: sheaths carry them to their own section.
        base_offset_mm: distance from the origin of the base frame to the start of the first section, along z.
        tip_offset_mm: vector from the end of the last section to the tip that targets mean, in the tip frame.
    """

    sections: Annotated[
        tuple[TendonSectionDescription, ...], Field(min_length=1, max_length=MAX_TENDON_SECTIONS)
    ]
    routing: Literal["through", "independent"] = "through"
    base_offset_mm: NonNegative = 0.0
    tip_offset_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def pull_matrix(self) -> NDArray[np.float64]:
        """Pulls of tendons by bends [m/rad], shape ``(tendons, 2 sections)``."""
        arms = [tendon_arms(each.radius_m, np.radians(each.angles_deg).tolist()) for each in self.sections]
        return pull_matrix(arms, through=self.routing == "through")


class TendonRobotLimits(Strict):
    """Limits of the robot.

    Attributes:
        pull_mm: ``[min, max]`` pull of the tendons from the straight robot, positive when a tendon shortens:
            one row for all, or one per section. With ``drives``, whose travel has limits of its own, it may
            be left out.
        bend_max_deg: largest bend of a section: one number for all, or one per section.
    """

    pull_mm: Annotated[tuple[Interval, ...], Field(min_length=1, max_length=MAX_TENDON_SECTIONS)] | None = (
        None
    )
    bend_max_deg: Annotated[
        tuple[Annotated[float, Field(gt=0, le=350)], ...], Field(min_length=1, max_length=MAX_TENDON_SECTIONS)
    ] = (180.0,)
