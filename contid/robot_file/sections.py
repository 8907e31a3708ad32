"""Robot descriptions of constant-curvature sections: lengths per section and their limits."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator, Mapping
from typing import Annotated, ClassVar, Final

import numpy as np
from pydantic import Field

from contid.errors import Located
from contid.robot_file.base import LengthInterval, Positive, Quantity, Strict
from contid.robot_file.positions import Document
from contid.robot_file.robot import RobotDescription, SectionLength
from contid.targets import Actuation
from contid.units import MM_PER_M

#: The kernels have scratch memory on the stack for this many sections.
MAX_SECTIONS = 8
_ROUNDED: Final = 1.0 + 1e-9


class SectionLimits(Strict):
    """Limits of the sections.

    Attributes:
        length_mm: ``[min, max]`` length of the tubes or racks, one row per section.
        bend_radius_min_mm: minimum bend radius of the backbone, in every section.
    """

    length_mm: Annotated[tuple[LengthInterval, ...], Field(min_length=1, max_length=MAX_SECTIONS)]
    bend_radius_min_mm: Positive | None = None


class SectionRobot(RobotDescription):
    """A chain of sections, each driven by three parallel lengths ``s1.l1`` .. ``sN.l3``."""

    quantity: ClassVar[Quantity] = Quantity.LENGTH
    dimension: ClassVar[int] = 3

    limits: SectionLimits

    @property
    def sections(self) -> int:
        """Number of sections: one row of ``limits.length_mm`` each."""
        return len(self.limits.length_mm)

    @property
    def axis_names(self) -> tuple[str, ...]:
        """Section by section from the base, tube by tube."""
        return tuple(f"s{s + 1}.l{j + 1}" for s in range(self.sections) for j in range(3))

    @property
    def accepts(self) -> frozenset[str]:
        """A tip, or bends; from two sections on also a direction, its whole frame or a mid-point."""
        more = {"direction", "rotation", "mid"} if self.sections > 1 else set()
        return super().accepts | more

    @property
    def section_lengths(self) -> tuple[SectionLength, ...]:
        """The mean of three tubes each."""
        rest = self.rest
        thirds = (sum(rest[3 * s : 3 * s + 3]) / 3.0 for s in range(self.sections))
        return tuple(SectionLength(length_m, changes=True) for length_m in thirds)

    @property
    def lower(self) -> Actuation:
        """Minimum length of every tube [m]."""
        return tuple(low / MM_PER_M for low, _ in self.limits.length_mm for _ in range(3))

    @property
    def upper(self) -> Actuation:
        """Maximum length of every tube [m]."""
        return tuple(high / MM_PER_M for _, high in self.limits.length_mm for _ in range(3))

    @property
    def curvature_max_per_m(self) -> float:
        """Maximum curvature of the backbone [1/m], inf without a bend radius."""
        radius_mm = self.limits.bend_radius_min_mm
        return float("inf") if radius_mm is None else MM_PER_M / radius_mm

    @property
    def rack_m(self) -> float:
        """Maximum sum of one rack's lengths over the sections [m]; inf for tubes."""
        return float("inf")

    @property
    @abstractmethod
    def radius_m(self) -> tuple[float, ...]:
        """Distance of the tubes from the backbone, one per section [m]."""

    @property
    @abstractmethod
    def tube_angles_deg(self) -> tuple[tuple[float, float, float], ...]:
        """Azimuth of the tubes of every section, counter-clockwise from +x seen from +z."""

    @property
    @abstractmethod
    def rigid_m(self) -> tuple[float, ...]:
        """Length of the rigid piece after every section [m]."""

    def per_section(self, values: tuple[float, ...] | None, what: str) -> tuple[float, ...]:
        """One number per section [m]: zeros when left out; one number applies to all.

        Raises:
            ValueError: neither one number nor one per section.
        """
        if values is None:
            return (0.0,) * self.sections
        if len(values) not in (1, self.sections):
            raise ValueError(
                f"{what} has {len(values)} numbers; allowed: 1 or {self.sections}, one per section"
            )
        each = values * self.sections if len(values) == 1 else values
        return tuple(value / MM_PER_M for value in each)

    def rest_beyond(self) -> str:
        """The limit that several lengths share and the rest pose exceeds, with numbers; "" for none."""
        rest = self.rest
        longest_m = max(sum(rest[j::3]) for j in range(3))
        if longest_m > self.rack_m * _ROUNDED:
            longest_mm, rack_mm = longest_m * MM_PER_M, self.rack_m * MM_PER_M
            return (
                f"a rack has {longest_mm:g} mm in all segments; allowed: at most rack_length_mm, {rack_mm:g}"
            )
        for s, (radius_m, angles_deg) in enumerate(zip(self.radius_m, self.tube_angles_deg, strict=True)):
            angles = np.radians(angles_deg)
            rows = np.stack((radius_m * np.cos(angles), radius_m * np.sin(angles), np.ones(3)), axis=-1)
            u, v, length_m = np.linalg.solve(rows, rest[3 * s : 3 * s + 3]).tolist()
            bend = math.hypot(u, v)
            if bend > self.curvature_max_per_m * length_m * _ROUNDED:
                radius_mm = length_m / bend * MM_PER_M
                least_mm = MM_PER_M / self.curvature_max_per_m
                return (
                    f"section {s + 1} has a bend radius of {radius_mm:.4g} mm; allowed: at least "
                    f"bend_radius_min_mm, {least_mm:g}"
                )
        return ""


def check_rest_poses(document: Document, robots: Mapping[str, RobotDescription | None]) -> Iterator[Located]:
    """Findings where a rest pose is outside limits that lengths share: a stop of policy ``rest`` never ends.

    Args:
        document: the robot file.
        robots: robots of the file, None for one with mistakes.
    """
    for name, robot in robots.items():
        if isinstance(robot, SectionRobot) and (what := robot.rest_beyond()):
            key = (
                "rest_mm" if robot.rest_mm is not None else "rest_mm is missing; half-way between the limits"
            )
            yield document.at_value(("robots", name, "rest_mm"), f"{key}: {what}")
