"""Robot description of the hyper-elastic pneumatic arm (Shi et al.): sections of three chamber pairs."""

from __future__ import annotations

import enum
import math
from typing import Annotated, ClassVar, Final, Literal, Self

from pydantic import Field, model_validator

from contid.robot_file.base import Interval, NonNegative, Positive, Quantity, Size, Strict
from contid.robot_file.clearance import PlaneDescription
from contid.robot_file.pneumatic.sense import ModelErrors, Sense
from contid.robot_file.robot import RobotDescription
from contid.targets import Actuation
from contid.units import BAR


class SectionGeometry(Strict):
    """One pneumatic section and the rigid part that follows it (Table I).

    Attributes:
        length_mm: chamber length at rest.
        link_mm: rigid length after the chambers: the connection to the next section, or the rigid tip.
        radius_mm: of the outside.
        channel_radius_mm: of the central channel.
        chamber_radius_mm: of one chamber.
        chamber_placement_mm: distance of the chambers' centres from the axis.
        pair_angle_deg: angle between the two chambers of one pair.
        first_pair_deg: azimuth of the first pair; not in the paper, 0 is +x.
        modulus_pa: b1..b5 of ``E = b1 x^4 + b2 x^3 + b3 x^2 + b4 x + b5``, E in Pa, x the average pressure in
            bar (eq. 20); `contid calibrate modulus` fits them.
        modulus_up_to_bar: x is clamped here (the printed fits rise again beyond, or were not measured).
        bending_gain: scale of the pressure's bending moment; 1 as derived.
        density_kg_m3: of the silicone; 0 for no weight.
        link_mass_g: of the rigid part.
    """

    length_mm: Size
    link_mm: NonNegative = 0.0
    radius_mm: Size
    channel_radius_mm: NonNegative
    chamber_radius_mm: Size
    chamber_placement_mm: Size
    pair_angle_deg: Annotated[float, Field(ge=0, lt=180)]
    first_pair_deg: float = 0.0
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


class CosseratGeometry(Strict):
    """Sections from base to tip, and the direction of gravity.

    Attributes:
        sections: one entry per section, from the base; each has three pressures.
        gravity: direction of gravity in the base frame. The arm grows along +z, so by default its tip hangs
            down. It applies to the arm's own weight; the load on the tip is a force of the trajectory.
    """

    sections: Annotated[tuple[SectionGeometry, ...], Field(min_length=1, max_length=8)]
    gravity: tuple[float, float, float] = (0.0, 0.0, 1.0)

    @property
    def gravity_unit(self) -> tuple[float, float, float]:
        """The direction of gravity as a unit vector."""
        x, y, z = self.gravity
        length = math.hypot(x, y, z)
        return (x / length, y / length, z / length)

    @model_validator(mode="after")
    def _gravity_points_somewhere(self) -> CosseratGeometry:
        if math.hypot(*self.gravity) == 0.0:
            raise ValueError(
                "gravity is a direction and must not be zero; leave densities at 0 for no weight"
            )
        return self


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
#: An error of a parameter [%].
_Percent = Annotated[float, Field(gt=-50, lt=100)]


class SimulatedErrors(Strict):
    """By what a simulated arm differs from the model of this file.

    Attributes:
        modulus_percent: by which the modulus of every section, from the base, is greater.
        moment_percent: by which the pressure moments are greater.
        regulator_bar: every regulator is off by a constant error up to this, drawn from ``seed``.
        hysteresis_bar: width of the play between the pressure of a regulator and what acts.
        seed: of the errors of the regulators.
    """

    modulus_percent: tuple[_Percent, ...] = ()
    moment_percent: _Percent = 0.0
    regulator_bar: NonNegative = 0.0
    hysteresis_bar: NonNegative = 0.0
    seed: int = 0


class SimulatedTracker(Strict):
    """The tracker of a simulated tip; its measurements arrive as those of a real one.

    Attributes:
        rate_hz: measurements per second.
        noise_mm: standard deviation of every component.
        latency_ms: from the capture of a measurement to its arrival.
        seed: of the noise.
        hidden_s: intervals without a measurement, after the bus was first opened.
    """

    rate_hz: Annotated[float, Field(gt=0, le=1000)] = 50.0
    noise_mm: NonNegative = 0.3
    latency_ms: Annotated[float, Field(ge=0, le=500)] = 10.0
    seed: int = 0
    hidden_s: tuple[Interval, ...] = ()


class SimulatedArm(Strict):
    """What ``--mock`` and ``driver: sim`` simulate beside the devices; real devices ignore it.

    The arm is at rest at every instant, by the literal equations of the paper, not by contid's model.

    Attributes:
        payload_g: mass that hangs on the tip.
        payload_at_s: when it is put on, after the bus was first opened.
        payload_until_s: when it is taken off; never when left out.
        wall: rigid and without friction, in the world; it stops the tip only.
        errors: by what the arm differs from the model.
        tracker: that measures the tip.
    """

    payload_g: NonNegative = 0.0
    payload_at_s: NonNegative = 0.0
    payload_until_s: Positive | None = None
    wall: PlaneDescription | None = None
    errors: SimulatedErrors = SimulatedErrors()
    tracker: SimulatedTracker = SimulatedTracker()

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.payload_until_s is not None and not self.payload_until_s > self.payload_at_s:
            raise ValueError(
                f"payload_until_s {self.payload_until_s:g} is not after payload_at_s {self.payload_at_s:g}"
            )
        return self


class Cosserat(RobotDescription):
    """A pneumatic arm of one or more sections; it grows along +z.

    Axes: ``s1.p1``, ``s1.p2``, ``s1.p3``, ``s2.p1`` and so on: section, chamber pair. Targets: a tip; from
    two sections on also its direction, or a mid-point beside it; a known force on the tip with any of them.

    Attributes:
        model: ``cosserat``.
        geometry: sections and the direction of gravity.
        limits: of the pressures.
        solver: of the inverse kinematics.
        sense: the force on the tip from a tracker; off when left out.
        load: ``estimated``: the solver gets the force that ``sense.load`` finds, in place of the one that
            targets state; ``known``: what targets state.
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
    sim: SimulatedArm | None = None

    @property
    def axis_names(self) -> tuple[str, ...]:
        """``s1.p1`` .. ``s1.p3``, ``s2.p1`` ..: section, then chamber pair."""
        return tuple(f"s{i + 1}.p{k + 1}" for i in range(len(self.geometry.sections)) for k in range(3))

    @property
    def accepts(self) -> frozenset[str]:
        """One section has three pressures, too few for a direction."""
        kinds = {"tip", "actuation", "load"}
        return frozenset(kinds if len(self.geometry.sections) == 1 else kinds | {"mid", "direction"})

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
        axes, width = 3 * sections, 11 * sections
        for key, count in (
            ("offset_bar", axes), ("gain", axes), ("loop_bar", axes), ("modulus", sections),
            ("moment", sections), ("covariance_factor", width),
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
