"""The interface of every robot description, independent of its model."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from typing import ClassVar, Final, NamedTuple

from pydantic import Field

from contid.robot_file.base import (
    AxisDescription,
    BasePose,
    Direction,
    Interval,
    NonNegative,
    Positive,
    Quantity,
    Stops,
    Strict,
    TipFeedback,
)
from contid.robot_file.rates import Rates
from contid.targets import Actuation, Vec3

#: Default of ``follow_mm``, ``follow_bar`` and ``follow_deg``.
_FOLLOW: Final = {Quantity.LENGTH: 1.0, Quantity.PRESSURE: 0.025, Quantity.ANGLE: 5.0}


class SectionLength(NamedTuple):
    """Length of a section whose bend a target may state.

    Attributes:
        rest_m: its length in the rest pose, mean over what drives it [m].
        changes: a target may state another one.
    """

    rest_m: float
    changes: bool


class TipSurface(NamedTuple):
    """The surface on which the tip of an arm of one section stays.

    Attributes:
        length_m: of the section, which it keeps [m].
        behind_m: rigid length from its end to the tip, along it [m].
    """

    length_m: float
    behind_m: float


class RobotDescription(Strict):
    """One robot of a file. Each model derives a class and adds geometry, limits and correction.

    Attributes:
        model: its kinematics; decides the further keys.
        base: pose of the base frame in the world.
        down: direction in which weight acts in the world, the same for every robot of a file. The weight of
            the robot itself follows it through ``base``: one that hangs from a ceiling has ``roll_deg: 180``.
        axes: one entry per axis of the model.
        rates: velocity, acceleration and jerk of the actuators.
        stop: policy for every reason to stop.
        rest_mm: rest pose of a robot whose axes are lengths, in the order of its axes.
        rest_bar: the same for pressures.
        extra_mm: ``[min, max]`` stroke of extra axes (wrist, gripper) by name, of a robot
            whose axes are lengths; they follow the model's axes.
        extra_bar: the same for pressures.
        extra_deg: ``[min, max]`` angle of extra axes that are servos or motors without
            pinion, of any robot; they follow the others, with ``velocity_deg_s`` and so on in ``rates``.
        feedback: closed loop on measured tip positions; off when left out.
        reach_tolerance_mm: a target out of reach by up to this counts as met, and the robot goes to the point
            of its reach that is nearest to it; only what the solver reaches does when left out.
        follow_mm: greatest distance of a measured length from where its command should have brought it;
            1 if left out. A body that is farther off is a fault, and has not arrived.
        follow_bar: the same for pressures; 0.025 if left out.
        follow_deg: the same for axes of ``extra_deg``; 5 if left out.
        follow_tip_mm: greatest distance of the tip of the measured axes from the way of the commanded tips;
            not compared if left out.
        follow_delay_ms: longest dead time of a healthy axis; that of its kind of device if left out.
        follow_lag_ms: longest time constant of its answer behind that; likewise.
        placeholder: dotted keys whose values are not measured yet, e.g. ``geometry.tip_length_mm``.
    """

    quantity: ClassVar[Quantity]
    #: 2 for planar robots (xy plane, growing along +y), 3 for spatial ones (along +z).
    dimension: ClassVar[int]

    model: str
    base: BasePose = BasePose()
    down: Direction = (0.0, 0.0, -1.0)
    axes: dict[str, AxisDescription] = Field(default_factory=dict)
    rates: Rates
    stop: Stops = Stops()
    rest_mm: tuple[float, ...] | None = None
    rest_bar: tuple[float, ...] | None = None
    extra_mm: dict[str, Interval] = Field(default_factory=dict)
    extra_bar: dict[str, Interval] = Field(default_factory=dict)
    extra_deg: dict[str, Interval] = Field(default_factory=dict)
    feedback: TipFeedback | None = None
    reach_tolerance_mm: Positive | None = None
    follow_mm: Positive | None = None
    follow_bar: Positive | None = None
    follow_deg: Positive | None = None
    follow_tip_mm: Positive | None = None
    follow_delay_ms: NonNegative | None = None
    follow_lag_ms: Positive | None = None
    placeholder: tuple[str, ...] = ()

    @property
    @abstractmethod
    def axis_names(self) -> tuple[str, ...]:
        """Names of the model's axes in its order; trajectory columns add the unit."""

    @property
    def down_unit(self) -> Vec3:
        """``down`` as a unit vector of the world."""
        x, y, z = self.down
        length = math.hypot(x, y, z)
        return (x / length, y / length, z / length)

    @property
    def down_in_base(self) -> Vec3:
        """``down`` as a unit vector of the base frame."""
        (x, y, z), r = self.down_unit, self.base.rotation
        return (
            r[0] * x + r[3] * y + r[6] * z,
            r[1] * x + r[4] * y + r[7] * z,
            r[2] * x + r[5] * y + r[8] * z,
        )

    @property
    def has_weight(self) -> bool:
        """True when the weight of the robot itself is part of its model."""
        return False

    @property
    def depends_on_down(self) -> bool:
        """True when the file holds values that are right for one direction of the weight only."""
        return False

    @property
    def extra_axis_names(self) -> tuple[str, ...]:
        """Extra axes (wrist, gripper), commanded by their own columns."""
        return (*self._extra, *self.extra_deg)

    @property
    def stages(self) -> tuple[str, ...]:
        """Stages of the tick that its keys ask for, by their names in the group ``contid.stages``."""
        return ()

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """What every axis is, in the order of `all_axis_names`."""
        own = len(self.axis_names) + len(self._extra)
        return (self.quantity,) * own + (Quantity.ANGLE,) * len(self.extra_deg)

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns of all axes with their units, without the name of the robot."""
        return tuple(
            f"{axis}_{quantity.unit}"
            for axis, quantity in zip(self.all_axis_names, self.quantities, strict=True)
        )

    def follow_tolerance(self, quantity: Quantity) -> float:
        """How far an axis may be from where its command should have brought it [m, Pa or rad]."""
        written: float | None = getattr(self, f"follow_{quantity.unit}")
        return quantity.to_si(_FOLLOW[quantity] if written is None else written)

    @property
    def _extra(self) -> Mapping[str, tuple[float, float]]:
        return self.extra_mm if self.quantity is Quantity.LENGTH else self.extra_bar

    @property
    def all_axis_names(self) -> tuple[str, ...]:
        """The model's axes, then the extra ones: the order of every command and sample."""
        return (*self.axis_names, *self.extra_axis_names)

    @property
    def extra_limits(self) -> Mapping[str, tuple[float, float]]:
        """Limits of the extra axes [m, Pa or rad]; a missing axis has none."""
        return {
            name: (quantity.to_si(low), quantity.to_si(high))
            for quantity, extra in ((self.quantity, self._extra), (Quantity.ANGLE, self.extra_deg))
            for name, (low, high) in extra.items()
        }

    @property
    def kinematics(self) -> str:
        """Name of the model, with the solver where there is a choice."""
        return self.model

    @property
    def accepts(self) -> frozenset[str]:
        """Kinds of target: tip, direction, mid, rotation, actuation, arcs, load."""
        return frozenset({"tip", "actuation"} | ({"arcs"} if self.section_lengths else set()))

    @property
    def section_lengths(self) -> tuple[SectionLength, ...]:
        """Of every section whose bend a target may state, from the base on."""
        return ()

    @property
    def tip_surface(self) -> TipSurface | None:
        """The surface of the tip, where a target may state x and y alone; None for a robot without."""
        return None

    @property
    def passive(self) -> bool:
        """True for robots without actuators of their own, such as a chain."""
        return False

    @property
    @abstractmethod
    def lower(self) -> Actuation:
        """Lower limit of every axis [m or Pa]."""

    @property
    @abstractmethod
    def upper(self) -> Actuation:
        """Upper limit of every axis [m or Pa]."""

    @property
    def coupling(self) -> tuple[tuple[float, ...], ...] | None:
        """Square matrix C with ``driven = C @ actuation`` (inputs of the transmissions); None: identity."""
        return None

    @property
    def driven_limits(self) -> tuple[tuple[float, float], ...]:
        """Range [m or Pa] of every transmission's input, extra axes last: the limits through `coupling`."""
        lower, upper = self.lower, self.upper
        extra = tuple(self.extra_limits.get(name, (-math.inf, math.inf)) for name in self.extra_axis_names)
        if self.coupling is None:
            return (*zip(lower, upper, strict=True), *extra)
        ranges = []
        for row in self.coupling:
            terms = [(c, low, high) for c, low, high in zip(row, lower, upper, strict=True) if c != 0.0]
            lowest = sum(c * (low if c > 0.0 else high) for c, low, high in terms)
            highest = sum(c * (high if c > 0.0 else low) for c, low, high in terms)
            ranges.append((lowest, highest))
        return (*ranges, *extra)

    @property
    def backlash(self) -> Actuation | None:
        """Half width of the backlash between every device and its axis [m or Pa]; None: there is none."""
        return None

    @property
    def rest(self) -> Actuation:
        """The rest pose [m or Pa]: as written, else half-way for lengths, minimum for pressures."""
        written = self.rest_mm if self.quantity is Quantity.LENGTH else self.rest_bar
        if written is not None:
            return tuple(self.quantity.to_si(value) for value in written)
        if self.quantity is Quantity.PRESSURE:
            return self.lower
        return tuple((low + high) / 2.0 for low, high in zip(self.lower, self.upper, strict=True))

    @property
    def rate_limits(self) -> tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]:
        """Maximum velocity, acceleration and jerk of every axis, extra ones too [per s, s^2, s^3]."""
        kinds = (("velocity", "s"), ("acceleration", "s2"), ("jerk", "s3"))
        velocity, acceleration, jerk = (
            tuple(self._rate(f"{what}_{quantity.unit}_{per}", quantity) for quantity in self.quantities)
            for what, per in kinds
        )
        return velocity, acceleration, jerk

    def _rate(self, key: str, quantity: Quantity) -> float:
        value: float | None = getattr(self.rates, key)
        if value is None:
            raise ValueError(f"rates.{key} is missing")
        return quantity.to_si(value)
