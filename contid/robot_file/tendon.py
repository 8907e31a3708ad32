"""Robot description of tendon robots: sections in series on one backbone, bent by tendons on spools."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from contid.robot_file.base import Interval, NonNegative, Positive, Quantity, Size, Strict
from contid.robot_file.robot import RobotDescription
from contid.targets import Actuation, Vec3
from contid.units import MM_PER_M

#: The native kernel has scratch memory on the stack for this many sections.
MAX_TENDON_SECTIONS = 8
MAX_TENDONS = 8  # of a section

_PerSection = Annotated[tuple[NonNegative, ...], Field(min_length=1, max_length=MAX_TENDON_SECTIONS)]
_PerSectionPositive = Annotated[tuple[Positive, ...], Field(min_length=1, max_length=MAX_TENDON_SECTIONS)]


class TendonSectionDescription(Strict):
    """One section of the backbone and the tendons that end at its disc.

    Attributes:
        length_mm: length of the backbone between the discs; it does not change.
        radius_mm: distance of the tendons from the backbone, one number or one per tendon.
        angles_deg: azimuth of each tendon, counter-clockwise from +x seen from +z; three or more, all around.
        rigid_mm: rigid piece after the section, such as a thick disc.
    """

    length_mm: Size
    radius_mm: Annotated[tuple[Size, ...], Field(min_length=1, max_length=MAX_TENDONS)]
    angles_deg: Annotated[tuple[float, ...], Field(min_length=3, max_length=MAX_TENDONS)]
    rigid_mm: NonNegative = 0.0

    @model_validator(mode="after")
    def _check_angles(self) -> TendonSectionDescription:
        count = len(self.angles_deg)
        if len(self.radius_mm) not in (1, count):
            raise ValueError(
                f"radius_mm has {len(self.radius_mm)} numbers; allowed: 1 or {count}, one per tendon"
            )
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
        sections: from the base on.
        routing: ``through``: tendons run along the backbone through the sections before their own, and
            shorten with them; ``independent``: sheaths carry them to their own section.
        base_offset_mm: from the origin of the base frame to the start of the first section, along z.
        tip_offset_mm: from the end of the last section to the tip that targets mean, in the tip frame.
    """

    sections: Annotated[
        tuple[TendonSectionDescription, ...], Field(min_length=1, max_length=MAX_TENDON_SECTIONS)
    ]
    routing: Literal["through", "independent"] = "through"
    base_offset_mm: NonNegative = 0.0
    tip_offset_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)


class TendonRobotLimits(Strict):
    """Limits of the robot.

    Attributes:
        pull_mm: ``[min, max]`` pull of the tendons from the straight robot, positive when a tendon shortens:
            one row for all, or one per section.
        bend_max_deg: largest bend of a section: one number for all, or one per section.
    """

    pull_mm: Annotated[tuple[Interval, ...], Field(min_length=1, max_length=MAX_TENDON_SECTIONS)]
    bend_max_deg: Annotated[
        tuple[Annotated[float, Field(gt=0, le=350)], ...], Field(min_length=1, max_length=MAX_TENDON_SECTIONS)
    ] = (180.0,)


class Tension(Strict):
    """Tension of the tendons; without it pulls are geometric and tensions are not bounded.

    Attributes:
        floor_n: least tension: pretension of the straight robot, below which a tendon counts as slack.
        max_n: largest tension.
        bending_n_mm2: bending stiffness E I of the backbone: one number for all, or one per section.
        tendon_n_per_mm: stiffness of a tendon from spool to disc: one number for all, or one per section.
    """

    floor_n: Positive
    max_n: Positive
    bending_n_mm2: Annotated[tuple[Positive, ...], Field(min_length=1, max_length=MAX_TENDON_SECTIONS)]
    tendon_n_per_mm: Annotated[tuple[Positive, ...], Field(min_length=1, max_length=MAX_TENDON_SECTIONS)]

    @model_validator(mode="after")
    def _check_range(self) -> Tension:
        if self.max_n < 2.0 * self.floor_n:
            raise ValueError(f"max_n {self.max_n:g} is less than twice floor_n, {2.0 * self.floor_n:g}")
        return self


class TendonRodStatics(Strict):
    """Statics of the backbone as a rod under tendons, weight and a force on the tip; needs ``tension``.

    Left out, sections are arcs, which is exact without loads, and 30 times faster.

    Attributes:
        weight_n_per_m: weight of the robot along its backbone: one number for all, or one per section.
        gravity: its direction in the base frame.
        torsion_n_mm2: torsional stiffness G J: one number for all, or one per section; left out, E I / 1.3,
            a round rod of nitinol or steel.
        stretch_n: stiffness E A of an extensible backbone, such as a spring: one number for all, or one per
            section; left out, it is inextensible.
        elements: of a section; the error falls with the square of their number.
    """

    weight_n_per_m: _PerSection = (0.0,)
    gravity: tuple[float, float, float] = (0.0, 0.0, -1.0)
    torsion_n_mm2: _PerSectionPositive | None = None
    stretch_n: _PerSectionPositive | None = None
    elements: Annotated[int, Field(ge=2, le=32)] = 6

    @model_validator(mode="after")
    def _check_gravity(self) -> TendonRodStatics:
        if not 1e-6 < math.hypot(*self.gravity) < math.inf:
            raise ValueError("gravity is a direction, such as [0, 0, -1]")
        return self


class TendonFriction(Strict):
    """Friction of the tendons; left out, there is none.

    Attributes:
        play_mm: half width of the play between a spool and its disc, by which pulls lead in the direction of
            motion: one number for all tendons, one per section, or one per tendon.
        capstan: coefficient of friction of tendons in the bends, by which pulls lead the loss of tension: one
            number for all sections, or one per section; needs ``tension``.
    """

    play_mm: Annotated[
        tuple[NonNegative, ...], Field(min_length=1, max_length=MAX_TENDON_SECTIONS * MAX_TENDONS)
    ] = (0.0,)
    capstan: Annotated[
        tuple[Annotated[float, Field(ge=0, le=1)], ...], Field(min_length=1, max_length=MAX_TENDON_SECTIONS)
    ] = (0.0,)


class TendonResidual(Strict):
    """What the model leaves of measured tips, written by ``contid calibrate tendon``; needs ``tension``.

    Features are the bends of the sections, x and y of each, then the stretches of the tendons; terms are the
    features, the products of bends u0 u0, u0 u1, .. and 1. Outside the range of the data it fades to nothing.

    Attributes:
        low_rad_mm, high_rad_mm: range of the features in the data.
        gain_x_mm, gain_y_mm, gain_z_mm: of the terms, for the three coordinates of the tip in the base frame.
        bound_mm: no correction is longer.
    """

    low_rad_mm: tuple[float, ...]
    high_rad_mm: tuple[float, ...]
    gain_x_mm: tuple[float, ...]
    gain_y_mm: tuple[float, ...]
    gain_z_mm: tuple[float, ...]
    bound_mm: NonNegative


class TendonRobot(RobotDescription):
    """A tendon robot of one to eight sections; it grows along +z.

    Axes: ``s1.t1``, ``s1.t2`` and so on: section, tendon; their values are pulls from the straight robot.
    Targets: a tip; from three sections on also its direction, its whole frame, or a mid-point beside it.

    Attributes:
        model: ``tendon``.
        geometry: dimensions.
        limits: of pulls and bends.
        tension: of the tendons; bounds them and adds the stretch of tendons to the pulls.
        friction: of the tendons; off when left out.
        rod: statics of the backbone under loads; off when left out.
        residual: correction of the tip from a calibration; off when left out.
    """

    quantity: ClassVar[Quantity] = Quantity.LENGTH
    dimension: ClassVar[int] = 3

    model: Literal["tendon"]
    geometry: TendonRobotGeometry
    limits: TendonRobotLimits
    tension: Tension | None = None
    friction: TendonFriction | None = None
    rod: TendonRodStatics | None = None
    residual: TendonResidual | None = None

    @model_validator(mode="after")
    def _consistent(self) -> TendonRobot:
        count = self.sections
        rows = [("limits.pull_mm", self.limits.pull_mm), ("limits.bend_max_deg", self.limits.bend_max_deg)]
        if self.tension is not None:
            rows.append(("tension.bending_n_mm2", self.tension.bending_n_mm2))
            rows.append(("tension.tendon_n_per_mm", self.tension.tendon_n_per_mm))
        if self.rod is not None:
            if self.tension is None:
                raise ValueError("rod needs tension, which has the stiffness of the backbone and the tendons")
            for key in ("weight_n_per_m", "torsion_n_mm2", "stretch_n"):
                if (values := getattr(self.rod, key)) is not None:
                    rows.append((f"rod.{key}", values))
        if self.friction is not None:
            rows.append(("friction.capstan", self.friction.capstan))
            self._check_capstan(self.friction)
        for what, values in rows:
            if len(values) not in (1, count):
                raise ValueError(f"{what} has {len(values)} entries; allowed: 1 or {count}, one per section")
        if self.residual is not None:
            self._check_residual(self.residual)
        play = () if self.friction is None else self.friction.play_mm
        if play and len(play) not in (1, count, len(self.axis_names)):
            raise ValueError(
                f"friction.play_mm has {len(play)} numbers; allowed: 1, {count} or {len(self.axis_names)}"
            )
        for low, high in self.limits.pull_mm:
            if not low < 0.0 < high:
                raise ValueError(
                    f"limits.pull_mm [{low:g}, {high:g}] has no room on both sides of 0, the straight robot"
                )
        return self

    def _check_capstan(self, friction: TendonFriction) -> None:
        if any(friction.capstan) and self.tension is None:
            raise ValueError("friction.capstan needs tension, which has the stiffness of the tendons")
        if any(friction.capstan) and self.rod is not None:
            raise ValueError("friction.capstan leads the model of arcs; leave out rod or capstan")

    def _check_residual(self, residual: TendonResidual) -> None:
        if self.tension is None:
            raise ValueError("residual needs tension, from which bends and stretches follow")
        bends = 2 * self.sections
        features = bends + len(self.axis_names)
        terms = features + bends * (bends + 1) // 2 + 1
        for key, count in (
            ("low_rad_mm", features), ("high_rad_mm", features),
            ("gain_x_mm", terms), ("gain_y_mm", terms), ("gain_z_mm", terms),
        ):  # fmt: skip
            if len(getattr(residual, key)) != count:
                raise ValueError(
                    f"residual.{key} has {len(getattr(residual, key))} numbers; allowed: {count}"
                )
        for low, high in zip(residual.low_rad_mm, residual.high_rad_mm, strict=True):
            if low > high:
                raise ValueError(f"residual: the range {low:g} to {high:g} is empty")

    @property
    def sections(self) -> int:
        """Number of sections."""
        return len(self.geometry.sections)

    @property
    def axis_names(self) -> tuple[str, ...]:
        """Section by section from the base, tendon by tendon."""
        return tuple(
            f"s{s + 1}.t{t + 1}"
            for s, section in enumerate(self.geometry.sections)
            for t in range(len(section.angles_deg))
        )

    @property
    def accepts(self) -> frozenset[str]:
        """A tip; from three sections on also a direction, its whole frame or a mid-point."""
        more = {"direction", "mid"} if self.sections > 2 else set()
        if self.rod is not None:
            more = more | {"load"}
        elif self.sections > 2:
            more = more | {"rotation"}
        return frozenset({"tip", "actuation"} | more)

    @property
    def kinematics(self) -> str:
        """``tendon``, or with loads ``tendon.rod``."""
        return self.model if self.rod is None else "tendon.rod"

    @property
    def lower(self) -> Actuation:
        """Least pull of every tendon [m]."""
        return self._per_tendon(tuple(low / MM_PER_M for low, _ in self.limits.pull_mm))

    @property
    def upper(self) -> Actuation:
        """Largest pull of every tendon [m]."""
        return self._per_tendon(tuple(high / MM_PER_M for _, high in self.limits.pull_mm))

    @property
    def rest(self) -> Actuation:
        """As written, else the straight robot."""
        return super().rest if self.rest_mm is not None else (0.0,) * len(self.axis_names)

    @property
    def play(self) -> Actuation | None:
        """``friction.play_mm`` per tendon [m]; None where it is off."""
        if self.friction is None or not any(self.friction.play_mm):
            return None
        play = tuple(r / MM_PER_M for r in self.friction.play_mm)
        return play if len(play) == len(self.axis_names) else self._per_tendon(play)

    @property
    def capstan(self) -> tuple[float, ...] | None:
        """``friction.capstan`` per section; None where it is off."""
        if self.friction is None or not any(self.friction.capstan):
            return None
        return self.per_section(self.friction.capstan)

    @property
    def tip_offset_m(self) -> Vec3:
        """``geometry.tip_offset_mm`` [m]."""
        x, y, z = self.geometry.tip_offset_mm
        return x / MM_PER_M, y / MM_PER_M, z / MM_PER_M

    def per_section(self, values: tuple[float, ...]) -> tuple[float, ...]:
        """One number per section."""
        return values * self.sections if len(values) == 1 else values

    def _per_tendon(self, values: tuple[float, ...]) -> tuple[float, ...]:
        return tuple(
            value
            for value, section in zip(self.per_section(values), self.geometry.sections, strict=True)
            for _ in section.angles_deg
        )
