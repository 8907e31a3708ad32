"""Robot description of the tri-rack arm (Hughes et al.): segments between platforms on three racks."""

from __future__ import annotations

from typing import Literal

from pydantic import model_validator

from contid.robot_file.base import Azimuth, NonNegative, Positive, Size, Strict
from contid.robot_file.sections import SectionLimits, SectionRobot
from contid.units import MM_PER_M


class TriRackGeometry(Strict):
    """Dimensions of the arm.

    Attributes:
        rack_radius_mm: distance of the racks from the backbone, the same in all segments.
        phi_deg: azimuth of rack 1; the paper's single segment has 180.
        convention: sense of phi and of the rack order, seen from +z. ``clockwise`` corrects the sign error of
            the printed M; ``counterclockwise`` mirrors the arm in y.
        platform_mm: thickness of the platform after each segment, one number or one per segment.
        coupling: where the racks are clamped. ``base_fixed``: platforms climb, segment 2's motors move by
            both lengths; ``tip_fixed``: segment 1's motors do; ``printed``: the paper's matrix, for study:
            strokes are negative when the second segment is longer.
    """

    rack_radius_mm: Size
    phi_deg: Azimuth = 180.0
    convention: Literal["clockwise", "counterclockwise"] = "clockwise"
    platform_mm: tuple[NonNegative, ...] | None = None
    coupling: Literal["base_fixed", "tip_fixed", "printed"] = "base_fixed"


class TriRackLimits(SectionLimits):
    """Limits of the arm.

    Attributes:
        rack_length_mm: free length of a rack: maximum sum of its lengths in all segments.
    """

    rack_length_mm: Positive | None = None


class TriRack(SectionRobot):
    """A tri-rack arm of one or more segments; it grows along +z.

    Axes: ``s1.l1``, ``s1.l2``, ``s1.l3``, ``s2.l1`` and so on: segment, rack. Targets: a tip; from two
    segments on also its direction, or a mid-point beside it.

    Attributes:
        model: ``tri_rack``.
        geometry: dimensions.
        limits: limits of the racks; as many segments as ``length_mm`` has rows.
    """

    model: Literal["tri_rack"]
    geometry: TriRackGeometry
    limits: TriRackLimits

    @model_validator(mode="after")
    def _consistent(self) -> TriRack:
        self.per_section(self.geometry.platform_mm, "geometry.platform_mm")
        retracted_mm = sum(low for low, _ in self.limits.length_mm)
        longest_mm = self.limits.rack_length_mm
        if longest_mm is not None and longest_mm <= retracted_mm:
            raise ValueError(
                f"limits.rack_length_mm {longest_mm:g} does not reach the retracted arm, {retracted_mm:g} mm"
            )
        return self

    @property
    def radius_m(self) -> tuple[float, ...]:
        """Distance of the racks from the backbone, the same for every segment [m]."""
        return (self.geometry.rack_radius_mm / MM_PER_M,) * self.sections

    @property
    def tube_angles_deg(self) -> tuple[tuple[float, float, float], ...]:
        """Clockwise: (-phi, -phi + 120, -phi - 120); counter-clockwise: (phi, phi - 120, phi + 120)."""
        phi = self.geometry.phi_deg
        if self.geometry.convention == "clockwise":
            return ((-phi, -phi + 120.0, -phi - 120.0),) * self.sections
        return ((phi, phi - 120.0, phi + 120.0),) * self.sections

    @property
    def rigid_m(self) -> tuple[float, ...]:
        """Thickness of the platforms [m]."""
        return self.per_section(self.geometry.platform_mm, "geometry.platform_mm")

    @property
    def rack_m(self) -> float:
        """The free rack length [m], inf when left out."""
        longest_mm = self.limits.rack_length_mm
        return float("inf") if longest_mm is None else longest_mm / MM_PER_M

    @property
    def coupling(self) -> tuple[tuple[float, ...], ...] | None:
        """Travel of the motors by segment lengths; platform thickness is part of each zero."""
        if self.sections == 1:
            return None
        order = range(self.sections)
        blocks = {
            "base_fixed": [[float(column <= row) for column in order] for row in order],
            "tip_fixed": [[float(column >= row) for column in order] for row in order],
            "printed": [
                [float(column == row) - float(column == row + 1) for column in order] for row in order
            ],
        }[self.geometry.coupling]
        axes = range(3 * self.sections)
        return tuple(
            tuple(blocks[row // 3][column // 3] if row % 3 == column % 3 else 0.0 for column in axes)
            for row in axes
        )
