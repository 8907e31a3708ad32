"""What every kind of robot description offers to the layers above, whatever its model."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import ClassVar

from pydantic import Field

from contid.robot_file.base import (
    AxisDescription,
    BasePose,
    Quantity,
    Rates,
    Stops,
    Strict,
    TipFeedback,
)
from contid.targets import Actuation


class RobotDescription(Strict):
    """One robot of a file. Each model derives one class from this and adds geometry, limits and correction.

    Attributes:
        model: its kinematics; decides which further keys there are.
        base: pose of the base frame in the world.
        axes: one entry per axis of the model, wired to a bus.
        rates: velocity, acceleration and jerk of the actuators.
        stop: what to do for every reason to stop.
        rest_mm: the rest pose of a robot whose axes are lengths, in the order of its axes.
        rest_bar: the same for pressures.
        feedback: closed loop on measured tip positions; off when left out.
        placeholder: dotted keys whose numbers no one measured, e.g. ``geometry.tip_length_mm``.
    """

    quantity: ClassVar[Quantity]
    #: 2 for planar robots, which live in x and y and grow along +y; 3 for spatial ones, along +z.
    dimension: ClassVar[int]

    model: str
    base: BasePose = BasePose()
    axes: dict[str, AxisDescription] = Field(default_factory=dict)
    rates: Rates
    stop: Stops = Stops()
    rest_mm: tuple[float, ...] | None = None
    rest_bar: tuple[float, ...] | None = None
    feedback: TipFeedback | None = None
    placeholder: tuple[str, ...] = ()

    @property
    @abstractmethod
    def axis_names(self) -> tuple[str, ...]:
        """Names of the model's actuation in its own order; trajectory columns add ``_mm`` or ``_bar``."""

    @property
    def extra_axis_names(self) -> tuple[str, ...]:
        """Axes beyond the kinematics (wrist, gripper), driven straight from their columns."""
        return ()

    @property
    def all_axis_names(self) -> tuple[str, ...]:
        """The model's axes, then the extra ones: the order of every command and sample."""
        return (*self.axis_names, *self.extra_axis_names)

    @property
    def extra_limits(self) -> Mapping[str, tuple[float, float]]:
        """Least and greatest value of every extra axis [m or Pa]; an axis that is missing is open."""
        return {}

    @property
    def kinematics(self) -> str:
        """Which implementation of the model answers: its name, and the solver where there is a choice."""
        return self.model

    @property
    def accepts(self) -> frozenset[str]:
        """Kinds of target: ``tip``, ``direction``, ``mid``, ``actuation``, ``load``."""
        return frozenset({"tip", "actuation"})

    @property
    def passive(self) -> bool:
        """True for robots without actuators of their own, such as a chain that only watches its arms."""
        return False

    @property
    @abstractmethod
    def lower(self) -> Actuation:
        """Least value of every axis [m or Pa]."""

    @property
    @abstractmethod
    def upper(self) -> Actuation:
        """Greatest value of every axis [m or Pa]."""

    @property
    def coupling(self) -> tuple[tuple[float, ...], ...] | None:
        """Square matrix C with ``driven = C @ actuation`` (what the transmissions see), None for identity."""
        return None

    @property
    def rest(self) -> Actuation:
        """The rest pose [m or Pa]: as written, else half-way for lengths and the least pressures."""
        written = self.rest_mm if self.quantity is Quantity.LENGTH else self.rest_bar
        if written is not None:
            return tuple(value / self.quantity.per_si for value in written)
        if self.quantity is Quantity.PRESSURE:
            return self.lower
        return tuple((low + high) / 2.0 for low, high in zip(self.lower, self.upper, strict=True))

    @property
    def velocity_limit(self) -> float:
        """Greatest speed of an axis [m/s or Pa/s]."""
        return self._rate("velocity", "_s")

    @property
    def acceleration_limit(self) -> float:
        """Greatest acceleration of an axis [m/s^2 or Pa/s^2]."""
        return self._rate("acceleration", "_s2")

    @property
    def jerk_limit(self) -> float:
        """Greatest jerk of an axis [m/s^3 or Pa/s^3]."""
        return self._rate("jerk", "_s3")

    def _rate(self, what: str, per: str) -> float:
        value: float | None = getattr(self.rates, f"{what}_{self.quantity.unit}{per}")
        if value is None:
            raise ValueError(f"rates.{what}_{self.quantity.unit}{per} is missing")
        return value / self.quantity.per_si
