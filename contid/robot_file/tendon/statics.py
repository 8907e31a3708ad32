"""Forces of a tendon robot in its file: tensions, the backbone as a rod, friction, residual of the tip."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from contid.robot_file.base import NonNegative, Positive, Strict
from contid.robot_file.tendon.sections import MAX_TENDON_SECTIONS, MAX_TENDONS

_PerSection = Annotated[tuple[NonNegative, ...], Field(min_length=1, max_length=MAX_TENDON_SECTIONS)]
_PerSectionPositive = Annotated[tuple[Positive, ...], Field(min_length=1, max_length=MAX_TENDON_SECTIONS)]


class Tension(Strict):
    """Tension of the tendons; without it pulls are geometric and tensions are not bounded.

    Attributes:
        floor_n: least tension; the straight robot is pretensioned to it, and a tendon below it counts as
            slack.
        max_n: largest tension; at least twice ``floor_n`` plus ``swing_n``.
        bending_n_mm2: bending stiffness E I of the backbone: one number for all, or one per section.
        tendon_n_per_mm: axial stiffness of a tendon between its spool and its disc: one number for all, or
            one per section.
        pretension_n: tension of the tendons of the straight robot, which ``drives`` need; without them it is
            ``floor_n`` plus ``swing_n``.
        swing_n: how far a tension falls below that of the commands while the body accelerates and swings;
            commands keep ``floor_n`` and that, so that tensions in motion keep ``floor_n``.
            `contid modes --schedule` computes it.
        spring_n_per_mm: stiffness of a spring in series with each tendon: one number for all, or one per
            section; none when left out.
    """

    floor_n: Positive
    max_n: Positive
    bending_n_mm2: _PerSectionPositive
    tendon_n_per_mm: _PerSectionPositive
    pretension_n: Positive | None = None
    swing_n: NonNegative = 0.0
    spring_n_per_mm: _PerSectionPositive | None = None

    @model_validator(mode="after")
    def _check_range(self) -> Tension:
        if self.max_n < 2.0 * self.commanded_floor_n:
            what = "floor_n" if self.swing_n == 0.0 else "floor_n plus swing_n"
            raise ValueError(
                f"max_n {self.max_n:g} is less than twice {what}, {2.0 * self.commanded_floor_n:g}"
            )
        if self.pretension_n is not None and self.swing_n:
            raise ValueError("swing_n is for robots with a motor per tendon; leave out pretension_n or it")
        if self.pretension_n is not None and not self.floor_n < self.pretension_n < self.max_n:
            raise ValueError(
                f"pretension_n {self.pretension_n:g} is not between floor_n {self.floor_n:g} and max_n "
                f"{self.max_n:g}"
            )
        return self

    @property
    def commanded_floor_n(self) -> float:
        """Least tension of the commands, at rest: that of the straight robot without drives."""
        return self.floor_n + self.swing_n


class TendonRodStatics(Strict):
    """Statics of the backbone as a rod under tendons, weight and a force on the tip; needs ``tension``.

    Left out, sections are arcs, which is exact without loads, and 30 times faster.

    Attributes:
        weight_n_per_m: weight of the robot along its backbone: one number for all, or one per section;
            it acts along ``down`` of the world.
        torsion_n_mm2: torsional stiffness G J: one number for all, or one per section; left out, E I / 1.3,
            a round rod of nitinol or steel.
        stretch_n: stiffness E A of an extensible backbone, such as a spring: one number for all, or one per
            section; left out, it is inextensible.
        elements: number of elements of a section; the error falls with the square of it.
    """

    weight_n_per_m: _PerSection = (0.0,)
    torsion_n_mm2: _PerSectionPositive | None = None
    stretch_n: _PerSectionPositive | None = None
    elements: Annotated[int, Field(ge=2, le=32)] = 6


class TendonFriction(Strict):
    """Friction of the tendons; left out, there is none.

    Attributes:
        play_mm: half width of the backlash between a spool and its disc, by which pulls lead in the
            direction of motion: one number for all tendons, one per section, or one per tendon.
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
    """Correction of the model's tip, written by ``contid calibrate tendon``; needs ``tension``.

    It is the part of the measured tips that the fitted model does not explain: a sum of terms, each times its
    gain. Features are the bends of the sections, x and y of each, then the stretches of the tendons; terms
    are the features, the products of bends u0 u0, u0 u1, .. and 1. Outside the range of the data it fades to
    nothing.

    Attributes:
        low_rad_mm, high_rad_mm: range of every feature in the data, bends in rad, stretches in mm.
        gain_x_mm, gain_y_mm, gain_z_mm: gains of the terms for the coordinates of the tip in the base frame,
            in mm per unit of the term.
        bound_mm: length to which a longer correction is shortened.
    """

    low_rad_mm: tuple[float, ...]
    high_rad_mm: tuple[float, ...]
    gain_x_mm: tuple[float, ...]
    gain_y_mm: tuple[float, ...]
    gain_z_mm: tuple[float, ...]
    bound_mm: NonNegative
