"""Statics of a simulated pneumatic arm by the literal equations of its paper.

J. Shi, S.-A. Abad, J. S. Dai, H. A. Wurdemann: "Position and Orientation Control for Hyper-elastic
Multi-segment Continuum Robots", eqs. 1-11, with the errata of docs/robots/stiffflop.md.

It is another formulation than `contid.kinematics.cosserat`, which controls the arm: with the same equations
the simulated arm would share the errors of that model, and no test would show them. Here the internal force n
and moment m of the silicone are states, the six chambers push one by one, classical RK4 integrates a rotation
that it does not keep orthogonal, and the base moment is found by shooting: guessed, integrated to the tip,
and corrected by finite differences until no moment is left there. The kernel ``contid/kernels/plant`` solves
it.

"Wall" is a flat obstacle that the tip may touch. Its normal points out of it, to the side of the arm.

Units: mm, N, N·mm, bar; vectors are in the base frame of the arm.
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
    """An equilibrium of the arm.

    Attributes:
        tip_mm: position of the tip, three numbers [mm].
        unknowns: what the solver searched for: three components of the moment at the base [N·mm], then the
            force of the wall on the tip along its normal [N], 0 when the tip is not held.
        found: False when Newton's method did not converge; then the others mean nothing.
    """

    tip_mm: Numbers
    unknowns: Numbers
    found: bool


class SectionConstants(NamedTuple):
    """Constants of a section; the kernel reads them in this order.

    Attributes:
        length_mm: length without pressure [mm].
        link_mm: length of the rigid link after it [mm].
        area_mm2: area of the silicone in a cross-section [mm^2].
        inertia_mm4: second moment of that area about x and about y [mm^4].
        torsion_mm4: its polar second moment, about z [mm^4].
        push_n_per_bar: axial force of one pair of chambers [N/bar].
        pair1_x_nmm_per_bar, pair1_y_nmm_per_bar: moment of the first pair [N·mm/bar]; then the other two.
        modulus4_pa, modulus3_pa, modulus2_pa, modulus1_pa, modulus0_pa: coefficients of the modulus, a
            polynomial of the average pressure [bar], the highest power first [Pa].
        modulus_up_to_bar: end of the range of that polynomial; beyond it the modulus is constant [bar].
    """

    length_mm: float
    link_mm: float
    area_mm2: float
    inertia_mm4: float
    torsion_mm4: float
    push_n_per_bar: float
    pair1_x_nmm_per_bar: float
    pair1_y_nmm_per_bar: float
    pair2_x_nmm_per_bar: float
    pair2_y_nmm_per_bar: float
    pair3_x_nmm_per_bar: float
    pair3_y_nmm_per_bar: float
    modulus4_pa: float
    modulus3_pa: float
    modulus2_pa: float
    modulus1_pa: float
    modulus0_pa: float
    modulus_up_to_bar: float


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
        """The equilibrium next to a guess.

        Args:
            pressures: pressures in the pairs of chambers, three per section from the base on [bar].
            force: force on the tip that does not turn with it, such as a weight, three numbers [N].
            guess: four numbers as `PlantEquilibrium.unknowns`, such as those of an equilibrium nearby.
            held: True when the tip is to lie on the wall; False leaves the wall out.
            normal: unit normal of the wall, three numbers.
            offset: the wall is where ``normal . position = offset`` [mm].
        """


def section_constants(
    section: SectionGeometry, modulus_scale: float, moment_scale: float
) -> SectionConstants:
    """Sum the six or three chambers of a section one by one (eq. 5, with their projected distances).

    Args:
        section: dimensions in the robot file.
        modulus_scale: factor on the modulus, 1 without an error of the simulation.
        moment_scale: factor on the moments of the chambers, likewise.
    """
    outer, inner, chamber = section.radius_mm, section.channel_radius_mm, section.chamber_radius_mm
    chamber_area = math.pi * chamber**2
    single = section.pair_angle_deg is None
    half = 0.0 if section.pair_angle_deg is None else math.radians(section.pair_angle_deg) / 2.0
    area = math.pi * (outer**2 - inner**2)
    inertia = math.pi / 4.0 * (outer**4 - inner**4)
    push = (1.0 if single else 2.0) * chamber_area * NEWTON_PER_BAR_MM2
    pair_moments: list[float] = []
    for k in range(3):
        pair = math.radians(section.first_pair_deg + 120.0 * k)
        moment = [0.0, 0.0]
        for azimuth in (pair,) if single else (pair - half, pair + half):
            x, y = (
                section.chamber_placement_mm * math.cos(azimuth),
                section.chamber_placement_mm * math.sin(azimuth),
            )
            area -= chamber_area
            inertia -= math.pi / 4.0 * chamber**4 + chamber_area * y * y
            moment[0] += chamber_area * NEWTON_PER_BAR_MM2 * y
            moment[1] -= chamber_area * NEWTON_PER_BAR_MM2 * x
        pair_moments += [moment_scale * section.bending_gain * part for part in moment]
    modulus = [modulus_scale * b for b in section.modulus_pa]
    return SectionConstants._make((
        section.length_mm, section.link_mm, area, inertia, 2.0 * inertia, push, *pair_moments, *modulus,
        section.modulus_up_to_bar,
    ))  # fmt: skip


def arm_solver(robot: Cosserat) -> Solve:
    """The solver of an arm with the errors that its ``sim`` gives to modulus and moments.

    Raises:
        KernelMissingError: It is not compiled in this installation.
    """
    assert robot.sim is not None
    errors, sections = robot.sim.errors, robot.geometry.sections
    constants = [
        section_constants(section, errors.modulus_scale(k), errors.moment_scale)
        for k, section in enumerate(sections)
    ]
    solve: Solve = load("plant").Arm(constants, STEPS).solve
    return solve
