"""Statics of a simulated pneumatic arm by the literal equations (Shi et al., eqs. 1-11).

The errata of docs/robots/stiffflop.md are applied. Another formulation than `contid.kinematics.cosserat` on
purpose: wall force n and wall moment m are states, the six chambers push one by one, classical RK4 integrates
a rotation that it does not keep orthogonal, and the base moment is found by shooting with finite differences.
The kernel ``contid/kernels/plant`` solves it.

Units: mm, N, N·mm, bar.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple, Protocol, TypeAlias

from contid.kernels import load
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.pneumatic.geometry import SectionGeometry

Numbers: TypeAlias = tuple[float, ...]

#: Steps of RK4 per section; halved, a tip moves by less than a micrometre.
STEPS: Final = 12
#: One bar on one mm^2 pushes with 0.1 N.
NEWTON_PER_BAR_MM2: Final = 0.1


class PlantEquilibrium(NamedTuple):
    """Tip [mm]; base moment [N·mm] and push of the wall [N], four numbers; whether they were found."""

    tip_mm: Numbers
    unknowns: Numbers
    found: bool


class Solve(Protocol):
    """Finds an equilibrium of an arm from a guess nearby."""

    def __call__(
        self,
        pressures: Sequence[float],
        force: Sequence[float],
        guess: Sequence[float],
        held: bool,
        normal: Sequence[float],
        offset: float,
    ) -> PlantEquilibrium:
        """The equilibrium.

        Args:
            pressures: that act [bar].
            force: dead, on the tip [N].
            guess: of the unknowns.
            held: the tip is on the wall.
            normal: of the wall.
            offset: of the wall along its normal [mm].
        """


def section_numbers(section: SectionGeometry, modulus_scale: float, moment_scale: float) -> Numbers:
    """Constants of a section: its six chambers summed one by one (eq. 5, with their projected distances).

    Length, link [mm], area [mm^2], inertia, torsion [mm^4], force of a pair [N/bar]; moments of the three
    pairs, x and y of each [N·mm/bar]; the five coefficients of the modulus [Pa]; end of its range [bar].
    """
    outer, inner, chamber = section.radius_mm, section.channel_radius_mm, section.chamber_radius_mm
    chamber_area = math.pi * chamber**2
    half = math.radians(section.pair_angle_deg) / 2.0
    area = math.pi * (outer**2 - inner**2)
    inertia = math.pi / 4.0 * (outer**4 - inner**4)
    push = 2.0 * chamber_area * NEWTON_PER_BAR_MM2
    turn: list[float] = []
    for k in range(3):
        pair = math.radians(section.first_pair_deg + 120.0 * k)
        moment = [0.0, 0.0]
        for azimuth in (pair - half, pair + half):
            x, y = (
                section.chamber_placement_mm * math.cos(azimuth),
                section.chamber_placement_mm * math.sin(azimuth),
            )
            area -= chamber_area
            inertia -= math.pi / 4.0 * chamber**4 + chamber_area * y * y
            moment[0] += chamber_area * NEWTON_PER_BAR_MM2 * y
            moment[1] -= chamber_area * NEWTON_PER_BAR_MM2 * x
        turn += [moment_scale * section.bending_gain * part for part in moment]
    modulus = [modulus_scale * b for b in section.modulus_pa]
    return (
        section.length_mm, section.link_mm, area, inertia, 2.0 * inertia, push, *turn, *modulus,
        section.modulus_up_to_bar,
    )  # fmt: skip


def arm_solver(robot: Cosserat) -> Solve:
    """The solver of an arm with the errors of its ``sim``.

    Raises:
        KernelMissingError: It is not compiled in this installation.
    """
    assert robot.sim is not None
    errors, sections = robot.sim.errors, robot.geometry.sections
    moduli = (*errors.modulus_percent, *(0.0,) * len(sections))
    moment_scale = 1.0 + errors.moment_percent / 100.0
    rows = [
        section_numbers(section, 1.0 + percent / 100.0, moment_scale)
        for section, percent in zip(sections, moduli, strict=False)
    ]
    solve: Solve = load("plant").Arm(rows, STEPS).solve
    return solve
