"""Robots of a file in motion: tendon robots and pneumatic arms with ``dynamics`` as moving rods."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid.kinematics.cosserat.model import CosseratModel
from contid.kinematics.cosserat.section import Section
from contid.kinematics.model import build_model
from contid.kinematics.tendon.model import TendonModel
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.tendon.robot import TendonRobot
from contid.robot_file.tendon.statics import TendonRodStatics
from contid.targets import ZERO3, Vec3, vec3
from contid.units import MM_PER_M, STANDARD_GRAVITY
from contid_dynamics.rod import STRAINS, MovingElements, MovingRod, spread_mass
from contid_tendons.loaded import rod_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from contid.robot_file.dynamics import Dynamics
    from contid.robot_file.robot import RobotDescription

GRAM: Final = 1e-3


class Chambers:
    """Pneumatic sections whose pressures stiffen, stretch and bend their elements; N, mm and bar.

    Pressure shifts the strains at which an element is free of stress, `Section.inflated`; a moment of
    stiffness times that shift does the same, and is linear in the pressures.

    Args:
        sections: of the statics.
        elements: of each.

    Attributes:
        moments_per_bar: what each pressure adds to the strains' moments, ``(axes, elements, 6)`` [N m, N].
    """

    def __init__(self, sections: Sequence[Section], elements: int) -> None:
        self._sections = tuple(sections)
        count = len(sections) * elements
        #: Stiffness of the strains per modulus [N/mm^2], a row per section.
        self._per_modulus = np.zeros((len(sections), elements, STRAINS))
        self.moments_per_bar = np.zeros((3 * len(sections), count, STRAINS))
        for i, section in enumerate(self._sections):
            rows, h = slice(i * elements, (i + 1) * elements), section.length / elements
            found = section.inflated(np.zeros(3))
            # N mm of a turn become N m; N times mm of a strain become N m. Curvature (x, y) turns by (-v, u).
            rigidity = np.array(
                [1.0 / found.bend / h, 1.0 / found.bend / h, 1.0 / found.twist / h, h / found.axial,
                 h / found.shear, h / found.shear]
            ) / MM_PER_M  # fmt: skip
            self._per_modulus[i] = rigidity / section.modulus(0.0)[0]
            for k in range(3):
                x, y, _ = section.pair_moment[:, k]
                moments = np.array([y, -x, 0.0, section.pair_force * h, 0.0, 0.0]) / MM_PER_M
                self.moments_per_bar[3 * i + k, rows] = moments
        self._flat_moments = self.moments_per_bar.reshape(3 * len(sections), -1)

    def inflated(self, bars: Sequence[float]) -> tuple[Array, Array]:
        """Stiffness and moments of the strains, both ``(elements, 6)`` [N m, N], for pressures [bar]."""
        moduli = np.array(
            [each.modulus(sum(bars[3 * i : 3 * i + 3]) / 3.0)[0] for i, each in enumerate(self._sections)]
        )
        stiffness: Array = (moduli[:, None, None] * self._per_modulus).reshape(-1, STRAINS)
        # One row times a matrix: np.tensordot has the same bits and takes four times as long.
        moments = np.array([bars]) @ self._flat_moments
        return stiffness, moments.reshape(-1, STRAINS)


class MovingArm:
    """A robot of a file whose body moves; forces and poses are in its base frame.

    Args:
        robot: its description, with ``dynamics``.
        payload_kg: mass on the tip besides that of the file, with its weight.
        elements: of a section; None takes the file's number.

    Raises:
        ContidError: its model has no moving body, or its file no ``dynamics``.
    """

    def __init__(self, robot: RobotDescription, payload_kg: float = 0.0, elements: int | None = None) -> None:
        if not isinstance(robot, (Cosserat, TendonRobot)):
            raise ContidError(f"model {robot.model!r} has no moving body; allowed: cosserat, tendon")
        if robot.dynamics is None:
            raise ContidError(
                "dynamics: missing; the body in motion needs it: mass_g_per_m and damping_ms at least "
                "(docs/robots/dynamics.md)"
            )
        dynamics = robot.dynamics
        if elements is not None:
            dynamics = dynamics.model_copy(update={"elements": elements})
        self.robot, self.dynamics = robot, dynamics
        tip_kg = payload_kg + GRAM * dynamics.tip_mass_g
        down = STANDARD_GRAVITY * np.array(robot.down_in_base)
        self._gravity: Vec3 = vec3(down.tolist()) if robot.has_weight else ZERO3
        # Without weight of its own the arm still carries that of its payload.
        self._payload_n = ZERO3 if robot.has_weight else vec3((payload_kg * down).tolist())
        if isinstance(robot, TendonRobot):
            self.rod, self.offset_m = _tendon_rod(robot, dynamics, tip_kg)
        else:
            self._chambers, self._model, self.rod = _pneumatic_rod(robot, dynamics, tip_kg)
            self.offset_m = np.zeros(3)
        self._has_offset = bool(self.offset_m.any())

    def command(
        self, actuation: Sequence[float], tip_force_n: Vec3 = ZERO3, *, within_s: float = 0.0
    ) -> None:
        """What the actuators do from now on: pulls [m] or pressures [Pa], and a force on the tip.

        Pulls get there evenly ``within_s``, one step at least; pressures and the force act at once.
        """
        wrench = self._tip_wrench(tip_force_n)
        if isinstance(self.robot, TendonRobot):
            self.rod.load(
                gravity_m_s2=self._gravity,
                wrenches={self.rod.count - 1: wrench},
                pulls_m=np.array(actuation, dtype=np.float64),
                within_s=within_s,
            )
            return
        stiffness, strains = self._chambers.inflated(self._model.regulators.chambers(tuple(actuation)))
        self.rod.stiffen(stiffness)
        self.rod.load(gravity_m_s2=self._gravity, wrenches={self.rod.count - 1: wrench}, strains=strains)

    def settle(self, actuation: Sequence[float], tip_force_n: Vec3 = ZERO3, steps: int = 8) -> None:
        """Go from the straight arm to the equilibrium for an actuation, by parts of it.

        Raises:
            ArithmeticError: none was found.
        """
        self.rod.put(np.zeros((self.rod.count, STRAINS)))
        for share in np.linspace(1.0 / steps, 1.0, steps):
            part = [share * each for each in actuation]
            x, y, z = tip_force_n
            self.command(part, (share * x, share * y, share * z))
            self.rod.settle()

    @property
    def tip_m(self) -> Array:
        """The tip ``(3,)``."""
        (tip,) = self.tips_of(self.rod.poses[-1:])
        return np.asarray(tip)

    @property
    def radius_m(self) -> float:
        """Radius of the body, for drawings."""
        if self.dynamics.radius_mm is not None:
            return self.dynamics.radius_mm / MM_PER_M
        if isinstance(self.robot, Cosserat):
            return self.robot.geometry.sections[0].radius_mm / MM_PER_M
        return _mean_arm(self.rod.elements.arms)

    @property
    def moments_per_bar(self) -> Array:
        """What each pressure of a pneumatic arm adds to the strains' moments, ``(axes, elements, 6)``.

        The stiffness is the present one: moments are linear in the pressures beside it.
        """
        return self._chambers.moments_per_bar

    def tips_of(self, poses: Array) -> Array:
        """Tips ``(n, 3)`` of poses of the last node ``(n, 12)``."""
        tips: Array = poses[:, :3] + poses[:, 3:].reshape(-1, 3, 3) @ self.offset_m
        return tips

    def _tip_wrench(self, force_n: Vec3) -> list[float]:
        """A force on the tip as force and moment on the last node, as the node stands now."""
        fx, fy, fz = (a + b for a, b in zip(force_n, self._payload_n, strict=True))
        if not (fx or fy or fz) or not self._has_offset:
            return [fx, fy, fz, 0.0, 0.0, 0.0]
        x, y, z = (self.rod.poses[-1, 3:].reshape(3, 3) @ self.offset_m).tolist()
        return [fx, fy, fz, y * fz - z * fy, z * fx - x * fz, x * fy - y * fx]


def _tendon_rod(robot: TendonRobot, dynamics: Dynamics, tip_kg: float) -> tuple[MovingRod, Array]:
    model = build_model(robot.model_copy(update={"residual": None, "friction": None, "rod": None}))
    assert isinstance(model, TendonModel)
    assert model.statics is not None
    statics = robot.rod if robot.rod is not None else TendonRodStatics()
    described = robot.model_copy(update={"rod": statics.model_copy(update={"elements": dynamics.elements})})
    discrete = rod_of(described, model.geometry, model.statics).discrete
    count = len(discrete.lengths)
    per_m = dynamics.mass_g_per_m
    masses = np.array(
        robot.per_section(statics.weight_n_per_m if per_m is None else per_m), dtype=np.float64
    ) * (1.0 / STANDARD_GRAVITY if per_m is None else GRAM)
    radius_m = dynamics.radius_mm / MM_PER_M if dynamics.radius_mm is not None else _mean_arm(discrete.arms)
    middles, ends = spread_mass(
        discrete.lengths, np.repeat(masses, dynamics.elements), np.full(count, radius_m)
    )
    ends[-1, 0] += tip_kg
    stiffness = np.zeros((count, STRAINS))
    stiffness[:, :4] = discrete.stiffness
    elements = MovingElements(
        discrete.lengths, discrete.rigid, 4 if discrete.stretches else 3, middles, ends,
        np.ascontiguousarray(discrete.arms), discrete.tendon, discrete.rest, discrete.base_m,
    )  # fmt: skip
    return MovingRod(elements, stiffness, dynamics.damping_ms * 1e-3), np.array(discrete.offset)


def _mean_arm(arms: Array) -> float:
    return float(np.nanmean(np.hypot(arms[..., 0], arms[..., 1])))


def _pneumatic_rod(
    robot: Cosserat, dynamics: Dynamics, tip_kg: float
) -> tuple[Chambers, CosseratModel, MovingRod]:
    model = build_model(robot)
    assert isinstance(model, CosseratModel)
    n = dynamics.elements
    lengths, rigid, masses, radii = [], [], [], []
    sections = model.setup.rod.sections
    for i, (section, described) in enumerate(zip(sections, robot.geometry.sections, strict=True)):
        lengths += [section.length / n / MM_PER_M] * n
        rigid += [0.0] * (n - 1) + [section.link / MM_PER_M]
        if dynamics.mass_g_per_m is None:
            per_m = described.density_kg_m3 * section.area * 1e-6
        else:
            per_m = GRAM * dynamics.mass_g_per_m[i if len(dynamics.mass_g_per_m) > 1 else 0]
        masses += [per_m] * n
        radii += [(dynamics.radius_mm or described.radius_mm) / MM_PER_M] * n
    middles, ends = spread_mass(np.array(lengths), np.array(masses), np.array(radii))
    for i, described in enumerate(robot.geometry.sections):
        ends[(i + 1) * n - 1, 0] += GRAM * described.link_mass_g
    ends[-1, 0] += tip_kg
    count = len(lengths)
    elements = MovingElements(
        np.array(lengths), np.array(rigid), 6, middles, ends,
        np.zeros((count, 0, 2)), np.zeros(0), np.zeros(0),
    )  # fmt: skip
    chambers = Chambers(sections, n)
    stiffness, _ = chambers.inflated((0.0,) * (3 * len(sections)))
    return chambers, model, MovingRod(elements, stiffness, dynamics.damping_ms * 1e-3)
