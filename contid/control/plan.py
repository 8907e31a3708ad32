"""What the tick needs to know about the robots and never changes: built once, plain values only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Protocol

from contid.control.limits import AxisLimits, axis_limits
from contid.description.base import Quantity, StopPolicy, Stops
from contid.description.robot import RobotDescription
from contid.models.model import Model, build_model
from contid.targets import Actuation, Target, Vec3

#: Data younger than this are never stale: a slow regulator measures at 20 Hz or so.
STALE_S: Final = 0.1


class Transmission(Protocol):
    """Between a model's actuation [m or Pa] and the values of the devices [rad or Pa]."""

    def to_device(self, actuation: Actuation) -> tuple[float, ...]:
        """Device values of an actuation."""
        ...

    def to_actuation(self, device: tuple[float, ...]) -> Actuation:
        """Actuation that device values mean."""
        ...


@dataclass(frozen=True, slots=True)
class StopPlan:
    """The stop policies of one robot, out of reach of pydantic."""

    on_end: StopPolicy
    on_interrupt: StopPolicy
    on_fault: StopPolicy
    on_host_loss: StopPolicy
    estop: StopPolicy

    @classmethod
    def of(cls, stops: Stops) -> StopPlan:
        """The policies of a robot file."""
        return cls(stops.on_end, stops.on_interrupt, stops.on_fault, stops.on_host_loss, stops.estop)


@dataclass(frozen=True, slots=True)
class RobotPlan:
    """Everything fixed about one robot.

    Attributes:
        name: in the robot file.
        kind: its model's name.
        quantity: lengths or pressures.
        model: kinematics in the base frame.
        rotation: row-major 3x3, base to world (with the mirror).
        origin_in_world: of the base frame [m].
        limits: per axis, per tick.
        transmission: actuation to device values and back.
        axis_names: of the model.
        axes: names on the buses, in the same order.
        rest: the rest pose.
        stops: policy per reason.
        velocity, acceleration, jerk: greatest rates of an axis [1/s, 1/s^2, 1/s^3].
        tolerance: exchanges in a row each axis may miss.
        stale_s: age at which the data of each axis are no longer believed [s].
        period_s: of the tick.
    """

    name: str
    kind: str
    quantity: Quantity
    model: Model
    rotation: tuple[float, ...]
    origin_in_world: Vec3
    limits: tuple[AxisLimits, ...]
    transmission: Transmission
    axis_names: tuple[str, ...]
    axes: tuple[str, ...]
    rest: Actuation
    stops: StopPlan
    velocity: float
    acceleration: float
    jerk: float
    tolerance: tuple[int, ...]
    stale_s: tuple[float, ...]
    period_s: float

    def to_base(self, target: Target) -> Target:
        """A target of the world frame in the base frame: ``R^T (p - o)``; loads and directions turn."""
        rotation = self.rotation
        origin = self.origin_in_world
        tip, mid, load = target.tip_m, target.mid_m, target.load_n
        return Target(
            None if tip is None else _turned(rotation, tip, origin),
            None if target.direction is None else _turned(rotation, target.direction),
            None if mid is None else _turned(rotation, mid, origin),
            target.actuation,
            load if load == _ZERO else _turned(rotation, load),
            target.extra,
        )


_ZERO: Vec3 = (0.0, 0.0, 0.0)


def _turned(rotation: tuple[float, ...], vector: Vec3, origin: Vec3 = _ZERO) -> Vec3:
    x, y, z = vector[0] - origin[0], vector[1] - origin[1], vector[2] - origin[2]
    r = rotation
    return (
        r[0] * x + r[3] * y + r[6] * z,
        r[1] * x + r[4] * y + r[7] * z,
        r[2] * x + r[5] * y + r[8] * z,
    )


def plan_robot(
    name: str,
    robot: RobotDescription,
    transmission: Transmission,
    rate_hz: float,
    tolerance_of_bus: Mapping[str, int],
) -> RobotPlan:
    """The plan of one robot of a file at a rate [Hz]."""
    model = build_model(robot)
    tolerance = tuple(tolerance_of_bus[robot.axes[axis].bus] for axis in robot.axis_names)
    period_s = 1.0 / rate_hz
    return RobotPlan(
        name=name,
        kind=robot.model,  # type: ignore[attr-defined]  # every leaf class has it
        quantity=robot.quantity,
        model=model,
        rotation=robot.base.rotation,
        origin_in_world=robot.base.position_m,
        limits=axis_limits(
            robot.lower, robot.upper, robot.velocity_limit, robot.acceleration_limit, period_s
        ),
        transmission=transmission,
        axis_names=robot.axis_names,
        axes=tuple(f"{name}.{axis}" for axis in robot.axis_names),
        rest=robot.rest,
        stops=StopPlan.of(robot.stop),
        velocity=robot.velocity_limit,
        acceleration=robot.acceleration_limit,
        jerk=robot.jerk_limit,
        tolerance=tolerance,
        stale_s=tuple(max(ticks * period_s, STALE_S) for ticks in tolerance),
        period_s=period_s,
    )
