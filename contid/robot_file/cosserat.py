"""Robot description of the hyper-elastic pneumatic arm (Shi et al.): sections of three chamber pairs."""

from __future__ import annotations

import enum
from typing import Annotated, ClassVar, Final, Literal

from pydantic import Field, model_validator

from contid.robot_file.base import Interval, Positive, Quantity, Strict
from contid.robot_file.dynamics import Dynamics
from contid.robot_file.pneumatic.geometry import CosseratGeometry
from contid.robot_file.pneumatic.sense import ModelErrors, Sense
from contid.robot_file.pneumatic.simulated import SimulatedArm
from contid.robot_file.robot import RobotDescription, SectionLength
from contid.targets import Actuation
from contid.units import BAR, MM_PER_M


class CosseratLimits(Strict):
    """Pressures of the chamber pairs.

    Attributes:
        pressure_bar: ``[min, max]`` pressure of every pair.
        max_bar: another maximum for single pairs, by axis name: ``{s2.p1: 1.2}``.
    """

    pressure_bar: Interval
    max_bar: dict[str, Positive] = Field(default_factory=dict)


class Orientation(enum.StrEnum):
    """Meaning of a target's direction.

    ``direction``: position and tip axis. ``full_rotation``, for comparison: the paper's eq. 17, the whole tip
    frame, twist-free about the direction; roll cannot be commanded (without load the Jacobian has rank 5), so
    it converges only where the roll fits.
    """

    DIRECTION = "direction"
    FULL_ROTATION = "full_rotation"


class CosseratSolver(Strict):
    """Settings of the inverse kinematics.

    Attributes:
        orientation: ``direction``: a target's direction is that of the tip's axis. ``full_rotation``: the
            whole tip frame, as in the paper's eq. 17; for comparison, it converges only where the roll fits.
        elements: integration steps per section.
        error_mm: estimated discretisation error at which a solve under load doubles its elements.
        tolerance_mm: task error of a converged solution; the preference for ``centre_bar`` costs up to 2e-7.
        centre_bar: preferred pressure of redundant solutions; the middle by default.
        direction_length_mm: weight of one unit of direction against mm of position, in least squares.
    """

    orientation: Orientation = Orientation.DIRECTION
    elements: Annotated[int, Field(ge=1, le=64)] = 3
    error_mm: Positive = 0.03
    tolerance_mm: Annotated[float, Field(ge=1e-6)] = 1e-4
    centre_bar: float | None = None
    direction_length_mm: Positive = 42.0


#: No identified gain, modulus or moment is farther from the file's, as a part of it.
_MOST_ERROR: Final = 0.9


class Cosserat(RobotDescription):
    """A pneumatic arm of one or more sections; it grows along +z.

    Axes: ``s1.p1``, ``s1.p2``, ``s1.p3``, ``s2.p1`` and so on: section, chamber pair. Targets: a tip; from
    two sections on also its direction, or a mid-point beside it; a known force on the tip with any of them.

    Attributes:
        model: ``cosserat``.
        geometry: sections from base to tip.
        limits: limits of the pressures.
        solver: solver of the inverse kinematics.
        sense: the force on the tip from a tracker; off when left out.
        load: ``estimated``: the solver gets the force that ``sense.load`` finds, in place of the one that
            targets state; ``known``: what targets state.
        dynamics: masses, damping and answer of the actuators, for the arm in motion; off when left out.
        sim: payload, wall, errors and tracker of the simulated arm, for ``--mock`` and ``driver: sim``.
    """

    quantity: ClassVar[Quantity] = Quantity.PRESSURE
    dimension: ClassVar[int] = 3

    model: Literal["cosserat"]
    geometry: CosseratGeometry
    limits: CosseratLimits
    solver: CosseratSolver = CosseratSolver()
    sense: Sense | None = None
    load: Literal["known", "estimated"] = "known"
    dynamics: Dynamics | None = None
    sim: SimulatedArm | None = None

    @property
    def axis_names(self) -> tuple[str, ...]:
        """``s1.p1`` .. ``s1.p3``, ``s2.p1`` ..: section, then chamber pair."""
        return tuple(f"s{i + 1}.p{k + 1}" for i in range(len(self.geometry.sections)) for k in range(3))

    @property
    def has_weight(self) -> bool:
        """True where a density or the mass of a link is known."""
        found = self.correction
        identified = found is not None and bool(found.density_kg_m3)
        return identified or any(
            each.density_kg_m3 > 0.0 or each.link_mass_g > 0.0 for each in self.geometry.sections
        )

    @property
    def depends_on_down(self) -> bool:
        """True with weight, with a simulated payload, or with loads that are weighed."""
        return (
            self.has_weight or self.sense is not None or (self.sim is not None and self.sim.payload_g > 0.0)
        )

    @property
    def accepts(self) -> frozenset[str]:
        """Kinds of targets; the three pressures of a single section are too few for a direction."""
        kinds = super().accepts | {"load"}
        return kinds if len(self.geometry.sections) == 1 else kinds | {"mid", "direction"}

    @property
    def section_lengths(self) -> tuple[SectionLength, ...]:
        """Lengths without pressure."""
        return tuple(
            SectionLength(each.length_mm / MM_PER_M, changes=True) for each in self.geometry.sections
        )

    @property
    def lower(self) -> Actuation:
        """Minimum pressures [Pa]."""
        return tuple(self.limits.pressure_bar[0] * BAR for _ in self.axis_names)

    @property
    def upper(self) -> Actuation:
        """Maximum pressures [Pa]."""
        top = self.limits.pressure_bar[1]
        return tuple(self.limits.max_bar.get(name, top) * BAR for name in self.axis_names)

    @property
    def stages(self) -> tuple[str, ...]:
        """``sense`` asks for the estimate of the force on the tip."""
        return () if self.sense is None else ("load_sensing",)

    @property
    def correction(self) -> ModelErrors | None:
        """Identified error that the kinematics of this arm has; None: it bends as ``geometry`` states."""
        found = None if self.sense is None else self.sense.load.calibration
        return found if found is not None and found.corrects == "robot" else None

    @model_validator(mode="after")
    def _limits_fit(self) -> Cosserat:
        low = self.limits.pressure_bar[0]
        if self.load == "estimated" and self.sense is None:
            raise ValueError("load: estimated needs sense.load; `contid calibrate load` writes it")
        if self.sense is not None:
            self._check_calibration(self.sense.load.calibration)
        if self.dynamics is not None:
            weighed = all(each.density_kg_m3 > 0.0 for each in self.geometry.sections)
            self.dynamics.check(len(self.geometry.sections), len(self.axis_names), weighed)
        if self.sim is not None and self.sim.dynamics and self.dynamics is None:
            raise ValueError("sim.dynamics needs dynamics, which has the masses")
        if self.sim is not None and len(self.sim.errors.modulus_percent) > len(self.geometry.sections):
            raise ValueError(
                f"sim.errors.modulus_percent: {len(self.sim.errors.modulus_percent)} numbers for "
                f"{len(self.geometry.sections)} sections"
            )
        if low < 0.0:
            raise ValueError(f"limits.pressure_bar: chambers cannot be evacuated, got {low:g} bar")
        for name, top in self.limits.max_bar.items():
            if name not in self.axis_names:
                raise ValueError(f"limits.max_bar: no axis {name!r}; there are {', '.join(self.axis_names)}")
            if top <= low:
                raise ValueError(f"limits.max_bar: {name} must be above {low:g} bar")
        return self

    def _check_calibration(self, found: ModelErrors) -> None:
        sections = len(self.geometry.sections)
        weighed = sections if found.density_kg_m3 or found.link_mass_g else 0
        axes, width = 3 * sections, 11 * sections + 2 * weighed
        for key, count in (
            ("offset_bar", axes), ("gain", axes), ("loop_bar", axes), ("modulus", sections),
            ("moment", sections), ("density_kg_m3", weighed), ("link_mass_g", weighed),
            ("covariance_factor", width),
        ):  # fmt: skip
            if len(getattr(found, key)) != count:
                got = len(getattr(found, key))
                raise ValueError(f"sense.load.calibration.{key}: {count} entries are needed, got {got}")
        if any(len(row) > width for row in found.covariance_factor):
            raise ValueError(f"sense.load.calibration.covariance_factor: rows have at most {width} numbers")
        for key in ("gain", "modulus", "moment"):
            if not all(abs(part) < _MOST_ERROR for part in getattr(found, key)):
                raise ValueError(
                    f"sense.load.calibration.{key}: parts of the whole, "
                    f"between -{_MOST_ERROR:g} and {_MOST_ERROR:g}"
                )
