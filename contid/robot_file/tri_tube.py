"""Robot description of arms of pneumatic tubes in threes: the compact bionic handling assistant (CBHA)."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from contid.robot_file.base import Azimuth, NonNegative, Positive, Size, Strict
from contid.robot_file.sections import SectionRobot

_LAYOUTS = {"paper": (180.0, 60.0, -60.0), "ccw": (0.0, 120.0, 240.0)}


class TriTubeGeometry(Strict):
    """Dimensions of the arm.

    Attributes:
        radius_mm: distance of the tubes from the backbone, one number or one per section; where a section
            tapers, its mean.
        layout: azimuths of tube 1, 2, 3 of a section. ``paper``: 180, 60, -60 degrees, the only layout with
            which Eq. 2 and 3 of Singh et al. agree; ``ccw``: 0, 120, 240 degrees.
        angles_deg: instead of a layout, three azimuths, counter-clockwise from +x seen from +z.
        rigid_mm: rigid piece after each section, one number or one per section.
    """

    radius_mm: Annotated[tuple[Size, ...], Field(min_length=1)]
    layout: Literal["paper", "ccw"] = "paper"
    angles_deg: tuple[Azimuth, Azimuth, Azimuth] | None = None
    rigid_mm: tuple[NonNegative, ...] | None = None


class TubeSolver(Strict):
    """Settings of the inverse kinematics.

    Attributes:
        method: ``bounded``: exact for constant curvature, within every limit. ``ph``: tube lengths along a
            Pythagorean-hodograph quintic from base to tip, an approximation without mid-points, and
            with a rigid piece at the tip only.
        tolerance_mm: with ``ph``, the error of a converged solution; 5 when left out.
    """

    method: Literal["bounded", "ph"] = "bounded"
    tolerance_mm: Positive | None = None

    @model_validator(mode="after")
    def _of_one_method(self) -> TubeSolver:
        if self.method != "ph" and self.tolerance_mm is not None:
            raise ValueError("tolerance_mm needs method: ph; bounded converges to 1e-3 mm")
        return self


class TriTube(SectionRobot):
    """An arm of tubes in threes, lengths in, usually driven by pressure through tables; it grows along +z.

    Axes: ``s1.l1``, ``s1.l2``, ``s1.l3``, ``s2.l1`` and so on: section, tube.
    Targets: a tip; from two sections on also its direction, or a mid-point beside it.

    Attributes:
        model: ``tri_tube``.
        geometry: dimensions.
        limits: limits of the tubes; as many sections as ``length_mm`` has rows.
        solver: solver of the inverse kinematics.
    """

    model: Literal["tri_tube"]
    geometry: TriTubeGeometry
    solver: TubeSolver = TubeSolver()

    @model_validator(mode="after")
    def _consistent(self) -> TriTube:
        self.per_section(self.geometry.radius_mm, "geometry.radius_mm")
        self.per_section(self.geometry.rigid_mm, "geometry.rigid_mm")
        angles = self.tube_angles_deg[0]
        gaps = [(b - a) % 360.0 for a, b in zip(angles, (*angles[1:], angles[0]), strict=True)]
        if min(*gaps) < 1.0 or not (abs(sum(gaps) - 360.0) < 1e-6 or abs(sum(gaps) - 720.0) < 1e-6):
            raise ValueError("geometry.angles_deg: the three tubes must stand at three different azimuths")
        if self.solver.method == "ph" and any(self.rigid_m[:-1]):
            raise ValueError("geometry.rigid_mm: solver.method ph allows a piece after the last section only")
        return self

    @property
    def kinematics(self) -> str:
        """The model with its solver."""
        return "tri_tube.ph" if self.solver.method == "ph" else self.model

    @property
    def accepts(self) -> frozenset[str]:
        """Kinds of targets: those of every arm of sections, without mid-point and frame for ``ph``."""
        return super().accepts - {"mid", "rotation"} if self.solver.method == "ph" else super().accepts

    @property
    def radius_m(self) -> tuple[float, ...]:
        """Distance of the tubes from the backbone, per section [m]."""
        return self.per_section(self.geometry.radius_mm, "geometry.radius_mm")

    @property
    def tube_angles_deg(self) -> tuple[tuple[float, float, float], ...]:
        """The stated azimuths, or those of the layout, the same for every section."""
        return (self.geometry.angles_deg or _LAYOUTS[self.geometry.layout],) * self.sections

    @property
    def rigid_m(self) -> tuple[float, ...]:
        """Rigid piece after every section [m]."""
        return self.per_section(self.geometry.rigid_mm, "geometry.rigid_mm")
