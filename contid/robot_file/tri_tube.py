"""Robot description of arms of pneumatic tubes in threes: the compact bionic handling assistant (CBHA)."""

from __future__ import annotations

import math
from itertools import combinations
from typing import Annotated, Final, Literal

from pydantic import Field, model_validator

from contid.robot_file.base import Azimuth, NonNegative, Positive, Size, Strict
from contid.robot_file.sections import SectionRobot

#: Azimuths of tube 1, 2 and 3 [deg], by the name of the layout.
_LAYOUTS: Final = {"paper": (180.0, 60.0, -60.0), "ccw": (0.0, 120.0, 240.0)}
#: Nearer tubes bend the section in nearly the same direction [deg].
_LEAST_APART_DEG: Final = 1.0


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
    """An arm whose sections are three tubes each; it grows along +z.

    Its axes are the lengths of the tubes; usually pressures drive these, by tables (``axes.NAME.mm_to_bar``).

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
        for a_deg, b_deg in combinations(self.tube_angles_deg[0], 2):
            apart_deg = abs(math.remainder(a_deg - b_deg, 360.0))
            if apart_deg < _LEAST_APART_DEG:
                raise ValueError(
                    f"geometry.angles_deg: tubes at {a_deg:g} and {b_deg:g} are {apart_deg:g} degrees apart; "
                    f"allowed: three different azimuths, at least {_LEAST_APART_DEG:g} degrees apart"
                )
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
