"""A rod of pneumatic sections, and the loads on it.

Of a section: areas, second moments, chamber arms and the modulus polynomial.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from contid.kinematics.array import Array

#: One bar on one mm^2 pushes with 0.1 N.
NEWTON_PER_BAR_MM2 = 0.1
MPA_PER_PA = 1e-6


@dataclass(frozen=True)
class Section:
    """One extensible section and the rigid link that follows it; lengths in mm.

    Attributes:
        length: reference length of the section.
        link: length of the rigid part after it (the connection of two sections, or a rigid tip).
        area: silicone area A [mm^2].
        inertia: second moment I_x = I_y [mm^4].
        torsion: polar moment J_z [mm^4].
        chamber_area: area A_c of one chamber [mm^2].
        arm: distance of the resultant of a pair, or of a single chamber, from the axis [mm].
        modulus_pa: coefficients b1..b5 of ``E = b1 x^4 + b2 x^3 + b3 x^2 + b4 x + b5`` (eq. 20), x the
            average pressure of the section in bar, E in Pa.
        modulus_up_to_bar: x is clamped here; the fit is not valid beyond.
        bending_gain: scale of the pressure moment (1: constants as derived; docs/robots/stiffflop.md).
        first_pair_rad: azimuth of the first chamber pair.
        poisson: Poisson's ratio; G = E / 2 (1 + poisson).
        chambers: 6 in three pairs, or 3 single ones.
    """

    length: float
    link: float
    area: float
    inertia: float
    torsion: float
    chamber_area: float
    arm: float
    modulus_pa: tuple[float, float, float, float, float]
    modulus_up_to_bar: float = 1.9
    bending_gain: float = 1.0
    first_pair_rad: float = 0.0
    poisson: float = 0.5
    chambers: int = 6

    @classmethod
    def solid(cls, length: float, radius: float, modulus_pa: float, poisson: float) -> Section:
        """A solid round bar without chambers: dimensions [mm], Young's modulus [Pa]."""
        inertia = 0.25 * math.pi * radius**4
        return cls(
            length=length,
            link=0.0,
            area=math.pi * radius**2,
            inertia=inertia,
            torsion=2.0 * inertia,
            chamber_area=0.0,
            arm=0.0,
            modulus_pa=(0.0, 0.0, 0.0, 0.0, modulus_pa),
            poisson=poisson,
        )

    def cut(self, length: float) -> Section:
        """A piece of that length [mm]."""
        return replace(self, length=length)

    @classmethod
    def from_radii(
        cls,
        *,
        length: float,
        link: float,
        outer: float,
        inner: float,
        chamber: float,
        placement: float,
        pair_angle_rad: float | None,
        modulus_pa: tuple[float, float, float, float, float],
        modulus_up_to_bar: float = 1.9,
        bending_gain: float = 1.0,
        first_pair_rad: float = 0.0,
    ) -> Section:
        """Constants from radii [mm] (eq. 5, corrected); three single chambers without an angle of pairs.

        ``I = pi/4 (Ro^4 - Ri^4) - (6 pi Rc^4 / 4 + 3 Rp^2 A_c)``, ``J = 2 I``. Erratum: eq. 5 as printed
        takes the full distance of a chamber instead of its projection (I 19 % too small) and pi Rc^4 / 4 for
        a polar moment that is pi Rc^4 / 2. The six squared projections add up to 3 Rp^2 for any pair angle,
        those of three single chambers to half of it.
        """
        chamber_area = math.pi * chamber**2
        solid = math.pi / 4.0 * (outer**4 - inner**4)
        chambers = 3 if pair_angle_rad is None else 6
        taken = chambers * math.pi * chamber**4 / 4.0 + 0.5 * chambers * placement**2 * chamber_area
        inertia = solid - taken
        return cls(
            length=length,
            link=link,
            area=math.pi * (outer**2 - inner**2 - chambers * chamber**2),
            inertia=inertia,
            torsion=2.0 * inertia,
            chamber_area=chamber_area,
            arm=placement * math.cos(0.5 * (pair_angle_rad or 0.0)),
            modulus_pa=modulus_pa,
            modulus_up_to_bar=modulus_up_to_bar,
            bending_gain=bending_gain,
            first_pair_rad=first_pair_rad,
            chambers=chambers,
        )

    def modulus(self, average_bar: float) -> tuple[float, float]:
        """E [N/mm^2] and dE/dx [N/mm^2/bar] at an average pressure; flat beyond the clamp."""
        x = min(max(average_bar, 0.0), self.modulus_up_to_bar)
        b1, b2, b3, b4, b5 = self.modulus_pa
        value = (((b1 * x + b2) * x + b3) * x + b4) * x + b5
        slope = ((4.0 * b1 * x + 3.0 * b2) * x + 2.0 * b3) * x + b4
        inside = 0.0 <= average_bar < self.modulus_up_to_bar
        return value * MPA_PER_PA, slope * MPA_PER_PA if inside else 0.0

    @cached_property
    def pair_moment(self) -> Array:
        """Moment of each pair per bar in the section's frame [N·mm/bar], shape (3, 3), one column a pair."""
        psi = self.first_pair_rad + np.arange(3) * (2.0 * math.pi / 3.0)
        scale = self.bending_gain * self.pair_force * self.arm
        return scale * np.stack([np.sin(psi), -np.cos(psi), np.zeros(3)])

    @property
    def shear_ratio(self) -> float:
        """E / G: 3 for incompressible silicone."""
        return 2.0 * (1.0 + self.poisson)

    @property
    def pair_force(self) -> float:
        """Force of a pair, or of a single chamber, per bar [N/bar]."""
        return self.chambers / 3.0 * self.chamber_area * NEWTON_PER_BAR_MM2

    def inflated(self, pressures: Array) -> Inflated:
        """Compliances and reference strains at three pressures [bar], shape (3,)."""
        modulus, slope = self.modulus(float(pressures.sum()) / 3.0)
        bend = 1.0 / (modulus * self.inertia)
        axial = 1.0 / (modulus * self.area)
        return Inflated(
            bend=bend,
            twist=self.shear_ratio / (modulus * self.torsion),
            shear=self.shear_ratio * axial,
            axial=axial,
            strain=self.pair_force * float(pressures.sum()) * axial,
            curvature=bend * (self.pair_moment @ pressures),
            strain_per_bar=self.pair_force * axial,
            curvature_per_bar=bend * self.pair_moment,
            softening=-slope / (3.0 * modulus),
        )


@dataclass(frozen=True, slots=True)
class Inflated:
    """A section at given pressures: pressure only shifts the reference strains and sets the compliances.

    Attributes:
        bend, twist: 1/(E I) and 1/(G J) [1/(N·mm^2)].
        shear, axial: 1/(G A) and 1/(E A) [1/N].
        strain: reference elongation.
        curvature: reference curvature [1/mm], shape (3,).
        strain_per_bar: derivative of ``strain`` by each pressure at fixed modulus.
        curvature_per_bar: the same of ``curvature``, shape (3, 3), one column a pressure.
        softening: relative change of every compliance per bar of each pressure, ``-E' / (3 E)``.
    """

    bend: float
    twist: float
    shear: float
    axial: float
    strain: float
    curvature: Array
    strain_per_bar: float
    curvature_per_bar: Array
    softening: float


@dataclass(frozen=True)
class Rod:
    """Sections from base to tip."""

    sections: tuple[Section, ...]

    @property
    def pressures(self) -> int:
        """Number of pressures, three a section."""
        return 3 * len(self.sections)

    @cached_property
    def reach(self) -> float:
        """Length of the undeformed robot [mm]."""
        return sum(section.length + section.link for section in self.sections)

    def stations(self, parts: int) -> Array:
        """Reference arc lengths [mm] of a polyline: the base, equal parts of every section, ends of links."""
        found, begin = [np.zeros(1)], 0.0
        for section in self.sections:
            found.append(begin + section.length * np.arange(1, parts + 1) / parts)
            begin += section.length + section.link
            if section.link > 0.0:
                found.append(np.array([begin]))
        return np.concatenate(found)


def _zeros() -> Array:
    return np.zeros(3)


@dataclass(frozen=True)
class Loads:
    """Dead loads in the base frame.

    Attributes:
        tip_force, tip_moment: force and moment at the tip [N, N·mm].
        joint_force, joint_moment: force and moment at the end of section i, before its link, by i [N, N·mm].
        weight: weight per reference length of section i [N/mm], by i.
        link_weight: weight per length of link i [N/mm], by i.
    """

    tip_force: Array = field(default_factory=_zeros)
    tip_moment: Array = field(default_factory=_zeros)
    joint_force: dict[int, Array] = field(default_factory=dict)
    joint_moment: dict[int, Array] = field(default_factory=dict)
    weight: dict[int, Array] = field(default_factory=dict)
    link_weight: dict[int, Array] = field(default_factory=dict)

    def base_force(self, rod: Rod) -> Array:
        """N at the base [N], shape (3,), of the weights and the force on the tip."""
        total = self.tip_force.copy()
        for i, section in enumerate(rod.sections):
            total += section.length * self.weight.get(i, _zeros())
            total += section.link * self.link_weight.get(i, _zeros())
        return total

    @property
    def has_moments(self) -> bool:
        """True when a dead moment acts; it has no energy, so the kernel does not count unstable modes."""
        return any(np.any(moment) for moment in (self.tip_moment, *self.joint_moment.values()))
