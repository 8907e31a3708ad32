"""Model of the pneumatic arm: SI and named limits outside, mm, N and bar inside."""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from typing import Final

import numpy as np

from contid.kinematics.any_target import any_target
from contid.kinematics.array import Array, pseudo_inverse, step_lengths
from contid.kinematics.cosserat.compliance import sweep, tip_compliance
from contid.kinematics.cosserat.engine import NO_SNAP, Limits, RodSetup, RodSolver
from contid.kinematics.cosserat.identified import Regulators, identified_sections
from contid.kinematics.cosserat.section import Loads, Rod, Section
from contid.robot_file.cosserat import Cosserat, Orientation
from contid.robot_file.pneumatic.geometry import SectionGeometry
from contid.targets import REACH, ZERO3, Actuation, Pose, Solution, Target, Vec3, Wrench6
from contid.units import BAR, LIMIT_TOLERANCE_PA, MM_PER_M, mm_to_m

#: Acceleration of gravity in the reference solution [m/s^2] (Shi et al.).
REFERENCE_GRAVITY: Final = 9.81
#: Points of a polyline per element.
POINTS_PER_ELEMENT: Final = 12
ROLL_NOTE: Final = "orientation: full_rotation asks for a roll, which this arm cannot command"


def build_section(section: SectionGeometry) -> Section:
    """Section constants from the dimensions of a robot file."""
    return Section.from_radii(
        length=section.length_mm,
        link=section.link_mm,
        outer=section.radius_mm,
        inner=section.channel_radius_mm,
        chamber=section.chamber_radius_mm,
        placement=section.chamber_placement_mm,
        pair_angle_rad=None if section.pair_angle_deg is None else math.radians(section.pair_angle_deg),
        modulus_pa=section.modulus_pa,
        modulus_up_to_bar=section.modulus_up_to_bar,
        bending_gain=section.bending_gain,
        first_pair_rad=math.radians(section.first_pair_deg),
    )


def build_setup(robot: Cosserat) -> RodSetup:
    """Everything an engine needs, from a robot description; pressures are those in the chambers."""
    sections = identified_sections(robot)
    rod = Rod(tuple(build_section(section) for section in sections))
    down = np.array(robot.down_in_base)
    weight, link_weight = {}, {}
    for i, (described, section) in enumerate(zip(sections, rod.sections, strict=True)):
        # An identified density may come out below none.
        if described.density_kg_m3 != 0.0:
            # kg/m^3 * mm^2 is 1e-9 kg/mm.
            weight[i] = described.density_kg_m3 * section.area * 1e-9 * REFERENCE_GRAVITY * down
        if described.link_mass_g != 0.0 and section.link > 0.0:
            link_weight[i] = described.link_mass_g * 1e-3 * REFERENCE_GRAVITY / section.link * down
    regulators = Regulators(robot)
    lower, upper = (np.array(regulators.chambers(ends)) for ends in (robot.lower, robot.upper))
    centre = 0.5 * (lower + upper)
    if robot.solver.centre_bar is not None:
        preferred = np.array(regulators.at_bar([robot.solver.centre_bar] * rod.pressures))
        centre = np.clip(preferred, lower, upper)
    return RodSetup(
        rod=rod,
        weight=Loads(weight=weight, link_weight=link_weight),
        limits=Limits(lower, upper, centre),
        elements=robot.solver.elements,
        error=robot.solver.error_mm,
        tolerance=robot.solver.tolerance_mm,
        direction_length=robot.solver.direction_length_mm,
        full_rotation=robot.solver.orientation is Orientation.FULL_ROTATION,
    )


class CosseratModel:
    """Statics of one arm: tip, mid-point and tip, or tip and direction, under a known force on the tip."""

    dimension = 3
    #: Which equilibrium a loaded arm gets to depends on the way; the searched one is a straight line.
    straight_approach = True

    def __init__(self, robot: Cosserat) -> None:
        self.axis_names = robot.axis_names
        self.lower = robot.lower
        self.upper = robot.upper
        #: Names in `Solution.limited_by`, in its order.
        self.limit_names = (
            *(f"{axis}.{end}" for axis in self.axis_names for end in ("min", "max")),
            *("stability", "iterations", REACH),
        )
        self.regulators = Regulators(robot)
        self.setup = build_setup(robot)
        self.engine = RodSolver(self.setup)
        #: Reference arc lengths of the backbone [mm].
        self._stations = self.setup.rod.stations(POINTS_PER_ELEMENT * self.setup.elements)

    def for_ticks(self) -> CosseratModel:
        """The same arm; searches for the nearest pose to a target out of reach are short: see `RodSetup`."""
        short = copy(self)
        short.setup = replace(self.setup, thorough=False)
        short.engine = RodSolver(short.setup)
        return short

    def forward(self, actuation: Actuation, load_n: Vec3 = ZERO3) -> Pose:
        """Pose on the branch that grows from the unloaded shape; ``stable`` is False once it has buckled."""
        found = self.engine.forward(self.regulators.chambers(actuation), load_n)
        return Pose(
            tip_m=_metres(found.tip_mm),
            rotation=found.rotation,
            direction=(found.rotation[2], found.rotation[5], found.rotation[8]),
            mid_m=_metres(found.mid_mm),
            stable=found.stable,
        )

    def forward_under(self, actuation: Actuation, tip: Wrench6, mid: Wrench6) -> Pose:
        """Pose under wrenches on the tip and on the end of the first section, beside the own weight.

        Each is (fx, fy, fz [N], mx, my, mz [N·m]), dead, in the base frame. With a moment ``stable`` is only
        whether the pose is reached without a jump: a dead moment has no energy.
        """
        setup = self.setup
        at, on_mid = np.array(tip), np.array(mid)
        loads = Loads(
            at[:3],
            MM_PER_M * at[3:],
            {0: on_mid[:3]} if on_mid[:3].any() else {},
            {0: MM_PER_M * on_mid[3:]} if on_mid[3:].any() else {},
            setup.weight.weight,
            setup.weight.link_weight,
        )
        frames = np.empty((2, 12))
        stations = np.array([setup.rod.sections[0].length, setup.rod.reach])
        under = self.engine.statics(self.regulators.chambers(actuation), loads, stations, frames)
        end, rotation = frames[1, :3].tolist(), tuple(frames[1, 3:].tolist())
        return Pose(
            tip_m=_metres(end),
            rotation=rotation,
            direction=(rotation[2], rotation[5], rotation[8]),
            mid_m=_metres(frames[0, :3].tolist()),
            stable=under.carried == 1.0,
        )

    @any_target
    def inverse(self, target: Target, seed: Actuation) -> Solution:
        """Pressures for a target; within the limits the nearest to it when it is out of reach.

        Where every equilibrium found is unstable, the answer is the seed.
        """
        if target.actuation is not None:
            return self._clamped(target.actuation)
        if target.tip_m is None:
            raise ValueError("a pneumatic arm takes a tip position or pressures")
        x, y, z = target.tip_m
        mid = target.mid_m
        answer = self.engine.inverse(
            (x * MM_PER_M, y * MM_PER_M, z * MM_PER_M),
            None if mid is None else (mid[0] * MM_PER_M, mid[1] * MM_PER_M, mid[2] * MM_PER_M),
            target.direction,
            target.load_n,
            self.regulators.chambers(seed),
        )
        if not answer.stable:
            return self._refused(target, seed, answer.iterations)
        note = ""
        if self.setup.full_rotation and target.direction is not None:
            note = ROLL_NOTE
        commands, residual_m = self.regulators.commands(answer.pressures_bar), mm_to_m(answer.residual_mm)
        if answer.met:
            return Solution(commands, residual_m, True, iterations=answer.iterations, note=note)
        actuation = tuple(
            min(max(p, low), high) for p, low, high in zip(commands, self.lower, self.upper, strict=True)
        )
        limited = self._binding(actuation)
        remain = f"{answer.residual_mm:.4g} mm remain"
        if answer.snap < NO_SNAP:
            snaps = f"snaps through at {100.0 * answer.snap:.3g} % of"
            part = snaps if answer.snap < 1.0 else "is elsewhere after"
            why = (
                "the target lies on another branch of equilibria: on the straight way there the arm "
                f"{part} the pressure change; {remain}"
            )
            limited += ("stability",)
        elif answer.blocked:
            why = f"out of reach: {remain}, further the arm loses its stability"
            limited += ("stability",)
        elif answer.optimal:
            why = f"out of reach: {remain} inside the pressure limits"
        else:
            why = f"the solver stopped {answer.residual_mm:.4g} mm from the target"
            limited += ("iterations",)
        note += ("; " if note else "") + why
        return Solution(actuation, residual_m, False, limited or (REACH,), answer.iterations, note)

    def follows(self, load_n: Vec3) -> bool:
        """See `contid.kinematics.model.Following`; an arm that carries something may snap."""
        return not (self.setup.weight.weight or self.setup.weight.link_weight or any(load_n))

    def follow(self, target: Target, answer: Actuation) -> Solution:
        """See `contid.kinematics.model.Following`: an optimum beside the seed ends every search."""
        return self.inverse(target, answer)

    def jacobian(self, actuation: Actuation, load_n: Vec3 = ZERO3) -> Array:
        """Tip by pressures in equilibrium, shape (3, 3k) [m/Pa]."""
        chambers = self.regulators.chambers(actuation)
        equilibrium = self.engine.forward(chambers, load_n)
        near = None
        if equilibrium.stable and equilibrium.elements == self.setup.elements:  # the same derivatives
            near = self.engine.near(chambers, load_n, equilibrium.base_moment_nmm)
        if near is not None:
            by_pressure = np.reshape(near.by_pressure_mm_bar, (3, -1))
        else:  # with other elements, or unstable
            moment, loads = np.array(equilibrium.base_moment_nmm), self.setup.loads(load_n)
            swept = sweep(self.setup.rod, np.array(chambers), moment, loads, equilibrium.elements)
            held = pseudo_inverse(swept.moment_by[:, :3]) @ swept.moment_by[:, 3:]
            by_pressure = swept.tip_by[:, 3:] - swept.tip_by[:, :3] @ held
        result: Array = by_pressure / (MM_PER_M * BAR) * self.regulators.slopes
        return result

    def compliance(self, actuation: Actuation, load_n: Vec3 = ZERO3) -> Array:
        """Tip by a force on it at constant pressures, in equilibrium, shape (3, 3) [m/N]; symmetric."""
        pressures_bar = np.array(self.regulators.chambers(actuation))
        equilibrium = self.engine.forward(pressures_bar.tolist(), load_n)
        moment, loads = np.array(equilibrium.base_moment_nmm), self.setup.loads(load_n)
        return tip_compliance(self.setup.rod, pressures_bar, moment, loads, equilibrium.elements) / MM_PER_M

    def shape(self, actuation: Actuation, points: int, load_n: Vec3 = ZERO3) -> Array:
        """Backbone from base to tip at equal arc length of the deformed arm, shape (points, 3) [m]."""
        frames = np.empty((len(self._stations), 12))
        chambers, loads = self.regulators.chambers(actuation), self.setup.loads(load_n)
        self.engine.statics(chambers, loads, self._stations, frames)
        line = frames[:, :3]
        lengths = np.concatenate([[0.0], np.cumsum(step_lengths(line))])
        evenly = np.linspace(0.0, lengths[-1], points)
        return np.stack([np.interp(evenly, lengths, line[:, i]) for i in range(3)], axis=1) / MM_PER_M

    def arcs(self, actuation: Actuation, load_n: Vec3 = ZERO3) -> Array:
        """Bends and lengths of the sections (``contid/kernels/cosserat/bends.hpp``)."""
        found = self.engine.bends(self.regulators.chambers(actuation), load_n)
        return np.reshape(found, (-1, 3)) / (1.0, 1.0, MM_PER_M)

    def of_arcs(self, arcs: Sequence[float], seed: Actuation, load_n: Vec3 = ZERO3) -> Actuation:
        """Pressures that have these bends; NaN where none were found."""
        asked = [each * MM_PER_M if k % 3 == 2 else each for k, each in enumerate(arcs)]
        found = self.engine.of_bends(asked, load_n, self.regulators.chambers(seed))
        return (math.nan,) * len(seed) if found is None else self.regulators.asked(found)

    def critical_load_n(self, actuation: Actuation, load_n: Vec3, max_factor: float = 1.0) -> float | None:
        """Magnitude of the tip force along ``load_n`` at which the arm buckles at these pressures [N].

        The arm's own weight acts in full. None when the arm is stable up to ``max_factor`` times ``load_n``;
        0.0 when its own weight buckles it.
        """
        factor = self.engine.critical(self.regulators.chambers(actuation), load_n, max_factor)
        return None if factor is None else factor * math.hypot(*load_n)

    def _binding(self, actuation: Actuation) -> tuple[str, ...]:
        names = []
        for name, p, low, high in zip(self.axis_names, actuation, self.lower, self.upper, strict=True):
            if p <= low:
                names.append(f"{name}.min")
            elif p >= high:
                names.append(f"{name}.max")
        return tuple(names)

    def _clamped(self, requested: Actuation) -> Solution:
        actuation = tuple(
            min(max(p, low), high) for p, low, high in zip(requested, self.lower, self.upper, strict=True)
        )
        if actuation == requested:
            return Solution(actuation, 0.0, converged=True)
        off = max(abs(a - w) for a, w in zip(actuation, requested, strict=True))
        if off <= LIMIT_TOLERANCE_PA:
            return Solution(actuation, 0.0, converged=True)
        residual = math.dist(self.forward(actuation).tip_m, self.forward(requested).tip_m)
        note = f"pressures moved by up to {off / BAR:.4g} bar to stay inside the limits"
        return Solution(actuation, residual, False, self._binding(actuation), note=note)

    def _refused(self, target: Target, seed: Actuation, iterations: int) -> Solution:
        """Hold the seed: every equilibrium found for the target is unstable."""
        assert target.tip_m is not None
        actuation = tuple(
            min(max(p, low), high) for p, low, high in zip(seed, self.lower, self.upper, strict=True)
        )
        critical = self.critical_load_n(actuation, target.load_n) if any(target.load_n) else None
        if critical is None:
            why = "every equilibrium found for this target is unstable"
        else:
            why = (
                f"the arm buckles: at the present pressures it carries {critical:.4g} N "
                f"({critical / REFERENCE_GRAVITY * 1e3:.3g} g) along the load, "
                f"not {math.hypot(*target.load_n):.4g} N"
            )
        residual = math.dist(self.forward(actuation, target.load_n).tip_m, target.tip_m)
        return Solution(
            actuation, residual, False, ("stability",), iterations, f"{why}; holding the last command"
        )


def _metres(point: Sequence[float]) -> Vec3:
    return (point[0] / MM_PER_M, point[1] / MM_PER_M, point[2] / MM_PER_M)
