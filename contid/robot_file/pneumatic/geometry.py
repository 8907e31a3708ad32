"""The ``geometry`` of a pneumatic arm: its sections from base to tip."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from contid.robot_file.base import Azimuth, NonNegative, Positive, Size, Strict


class SectionGeometry(Strict):
    """One pneumatic section and the rigid part that follows it (Table I).

    Attributes:
        length_mm: chamber length at rest.
        link_mm: rigid length after the chambers: the connection to the next section, or the rigid tip.
        radius_mm: radius of the outside.
        channel_radius_mm: radius of the central channel.
        chamber_radius_mm: radius of one chamber.
        chamber_placement_mm: distance of the chambers' centres from the axis.
        chambers: 6 in three pairs, or 3 single ones.
        pair_angle_deg: angle between the two chambers of one pair, which do not overlap; not with 3.
        first_pair_deg: azimuth of the first pair or chamber; not in the paper, 0 is +x.
        modulus_pa: b1..b5 of ``E = b1 x^4 + b2 x^3 + b3 x^2 + b4 x + b5``, E in Pa, x the average pressure in
            bar (eq. 20); `contid calibrate modulus` fits them.
        modulus_up_to_bar: x is clamped here (the printed fits rise again beyond, or were not measured).
        bending_gain: scale of the pressure's bending moment; 1 as derived.
        density_kg_m3: density of the silicone; 0 for no weight.
        link_mass_g: mass of the rigid part.
    """

    length_mm: Size
    link_mm: NonNegative = 0.0
    radius_mm: Size
    channel_radius_mm: NonNegative
    chamber_radius_mm: Size
    chamber_placement_mm: Size
    chambers: Literal[3, 6] = 6
    pair_angle_deg: Annotated[float, Field(ge=0, lt=180)] | None = None
    first_pair_deg: Azimuth = 0.0
    modulus_pa: tuple[float, float, float, float, float]
    modulus_up_to_bar: Positive = 1.9
    bending_gain: Positive = 1.0
    density_kg_m3: NonNegative = 0.0
    link_mass_g: NonNegative = 0.0

    @model_validator(mode="after")
    def _possible(self) -> SectionGeometry:
        if self.chamber_placement_mm + self.chamber_radius_mm > self.radius_mm:
            raise ValueError("the chambers stick out of the section: placement + chamber radius > radius")
        if self.chamber_placement_mm - self.chamber_radius_mm < self.channel_radius_mm:
            raise ValueError(
                "the chambers cut into the central channel: placement - chamber radius < channel"
            )
        self._check_pairs()
        if self.link_mass_g > 0.0 and self.link_mm == 0.0:
            raise ValueError("link_mass_g needs a link_mm to act on")
        b1, b2, b3, b4, b5 = self.modulus_pa
        for i in range(101):
            x = self.modulus_up_to_bar * i / 100.0
            modulus = (((b1 * x + b2) * x + b3) * x + b4) * x + b5
            slope = ((4.0 * b1 * x + 3.0 * b2) * x + 2.0 * b3) * x + b4
            if modulus <= 0.0 or modulus - x * slope <= 0.0:
                raise ValueError(
                    f"modulus_pa at {x:.3g} bar: E must be positive and the elongation x/E must grow with x; "
                    f"E is {modulus:.4g} Pa there. Lower modulus_up_to_bar or fit again"
                )
        return self

    def _check_pairs(self) -> None:
        """Chambers of a pair, or single ones beside each other, do not overlap."""
        if self.chambers == 3:
            if self.pair_angle_deg is not None:
                raise ValueError("pair_angle_deg has no meaning for three single chambers; leave it out")
            if self.chamber_placement_mm * math.sqrt(3.0) < 2.0 * self.chamber_radius_mm:
                raise ValueError("chambers: three of this radius and placement overlap")
            return
        if self.pair_angle_deg is None:
            raise ValueError("pair_angle_deg is missing; for three single chambers write chambers: 3")
        apart_mm = 2.0 * self.chamber_placement_mm * math.sin(math.radians(self.pair_angle_deg) / 2.0)
        if apart_mm < 2.0 * self.chamber_radius_mm * (1.0 - 1e-9):
            least = math.degrees(2.0 * math.asin(self.chamber_radius_mm / self.chamber_placement_mm))
            raise ValueError(
                f"pair_angle_deg {self.pair_angle_deg:g}: the two chambers of a pair overlap, {apart_mm:.3g} "
                f"mm apart; allowed: at least {math.ceil(10.0 * least) / 10.0:g}. For three single chambers "
                "write chambers: 3; a pair in one place would count twice and bend too far"
            )


class CosseratGeometry(Strict):
    """Sections from base to tip.

    Attributes:
        sections: one entry per section, from the base; each has three pressures.
    """

    sections: Annotated[tuple[SectionGeometry, ...], Field(min_length=1, max_length=8)]
