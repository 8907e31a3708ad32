"""Parts that every robot description shares: base pose, axes, limits, stops.

Keys carry the unit of the file (``_mm``, ``_bar``, ``_deg``), properties the SI unit (``_m``, ``_pa``).
"""

from __future__ import annotations

import enum
import math
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from contid.targets import Vec3
from contid.units import BAR, DEG, MM_PER_M

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_Values = TypeVar("_Values", float, "NDArray[np.float64]")


class Strict(BaseModel):
    """Base of every part of a robot file: unknown keys are refused, values are frozen."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


Positive: TypeAlias = Annotated[float, Field(gt=0)]
NonNegative: TypeAlias = Annotated[float, Field(ge=0)]
#: A dimension of a robot [mm]. A smaller number was probably written in metres.
Size: TypeAlias = Annotated[float, Field(ge=0.1, le=1e5)]
#: An azimuth [deg]. In a far larger one the angles that are added to it are lost in rounding.
Azimuth: TypeAlias = Annotated[float, Field(ge=-3600, le=3600)]
#: A limit of a rate, in the unit of its key. Beyond these the duration of a motion is lost in rounding.
Rate: TypeAlias = Annotated[float, Field(ge=1e-3, le=1e12)]


def _ordered(pair: tuple[float, float]) -> tuple[float, float]:
    if not pair[0] < pair[1]:
        raise ValueError(f"the first number must be less than the second, got {pair[0]:g} and {pair[1]:g}")
    return pair


#: ``[min, max]`` with min < max.
Interval: TypeAlias = Annotated[tuple[float, float], AfterValidator(_ordered)]


def _not_negative(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[0] < 0:
        raise ValueError(f"a length is not negative, got {pair[0]:g}")
    return pair


#: ``[min, max]`` of a length.
LengthInterval: TypeAlias = Annotated[Interval, AfterValidator(_not_negative)]


def _points_somewhere(vector: Vec3) -> Vec3:
    if not 1e-6 < math.hypot(*vector) < math.inf:
        raise ValueError("direction must not be the zero vector, nor infinitely long")
    return vector


#: A vector of any length; only where it points matters.
Direction: TypeAlias = Annotated[Vec3, AfterValidator(_points_somewhere)]


class Quantity(enum.StrEnum):
    """Quantity of an axis: length [m], pressure [Pa], or the angle of an extra axis [rad]."""

    LENGTH = "length"
    PRESSURE = "pressure"
    ANGLE = "angle"

    @property
    def per_si(self) -> float:
        """Units of files and rows per SI unit: 1000 mm per m, 1e-5 bar per Pa, 57.3 degrees per rad."""
        divisor, factor = self.edge_si
        return divisor / factor

    def to_si(self, value: _Values) -> _Values:
        """A value in mm, bar or degrees as m, Pa or rad, rounded once; a number or an array."""
        divisor, factor = self.edge_si
        return value / divisor * factor

    def from_si(self, value: _Values) -> _Values:
        """A value in m, Pa or rad as mm, bar or degrees, rounded once; a number or an array."""
        divisor, factor = self.edge_si
        return value / factor * divisor

    @property
    def edge_si(self) -> tuple[float, float]:
        """Divisor and factor that make a number of a file SI. One of them is 1: it is rounded once."""
        if self is Quantity.LENGTH:
            return MM_PER_M, 1.0
        return 1.0, BAR if self is Quantity.PRESSURE else DEG

    @property
    def unit(self) -> str:
        """Suffix of keys and columns in this quantity."""
        return {Quantity.LENGTH: "mm", Quantity.PRESSURE: "bar", Quantity.ANGLE: "deg"}[self]


class Placement(Strict):
    """Pose of a frame in another one: rotation Rz(yaw) Ry(pitch) Rx(roll), then translation.

    Attributes:
        x_mm, y_mm, z_mm: its origin in the other frame.
        roll_deg: first rotation, about x of the other frame.
        pitch_deg: second rotation, about its y.
        yaw_deg: third rotation, about its z.
    """

    x_mm: float = 0.0
    y_mm: float = 0.0
    z_mm: float = 0.0
    roll_deg: float = 0.0
    pitch_deg: float = 0.0
    yaw_deg: float = 0.0

    @property
    def position_m(self) -> tuple[float, float, float]:
        """Origin of this frame in the other [m]."""
        return (self.x_mm / MM_PER_M, self.y_mm / MM_PER_M, self.z_mm / MM_PER_M)

    @property
    def rotation(self) -> tuple[float, ...]:
        """Row-major 3x3 matrix from this frame to the other."""
        cr, sr = _cos_sin_deg(self.roll_deg)
        cp, sp = _cos_sin_deg(self.pitch_deg)
        cy, sy = _cos_sin_deg(self.yaw_deg)
        return (
            cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr,
            sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr,
            -sp, cp * sr, cp * cr,
        )  # fmt: skip


class BasePose(Placement):
    """Pose of a robot's base frame in the world frame: rotation Rz(yaw) Ry(pitch) Rx(roll), then translation.

    Attributes:
        x_mm, y_mm, z_mm: origin of the base frame in the world.
        roll_deg: first rotation, about the world's x.
        pitch_deg: second rotation, about the world's y.
        yaw_deg: third rotation, about the world's z.
        mirror_x: mirror the robot in its own x first: the right finger of a hand.
    """

    mirror_x: bool = False

    @property
    def rotation(self) -> tuple[float, ...]:
        """Row-major 3x3 matrix from base to world, including the mirror (then its determinant is -1)."""
        xx, xy, xz, yx, yy, yz, zx, zy, zz = super().rotation
        flip = -1.0 if self.mirror_x else 1.0
        return (flip * xx, xy, xz, flip * yx, yy, yz, flip * zx, zy, zz)


def _cos_sin_deg(angle_deg: float) -> tuple[float, float]:
    """Cosine and sine, exact at quarter turns."""
    exact = {0.0: (1.0, 0.0), 90.0: (0.0, 1.0), 180.0: (-1.0, 0.0), 270.0: (0.0, -1.0)}
    angle_rad = math.radians(angle_deg)
    return exact.get(angle_deg % 360.0, (math.cos(angle_rad), math.sin(angle_rad)))


class StopPolicy(enum.StrEnum):
    """How a robot stops: hold position, move to the rest pose, torque off, or pressure to zero at a rate."""

    HOLD = "hold"
    REST = "rest"
    RELAX = "relax"
    VENT = "vent"


class ContactPolicy(enum.StrEnum):
    """Reaction to a contact; the event is written with each of them."""

    IGNORE = "ignore"  # the event only
    HOLD = "hold"  # stop jerk-limited and hold, as after `contid hold`
    STOP = "stop"  # latch fault 304 and stop by stop.on_fault
    RETRACT = "retract"  # stop, go back slowly to the command of half a second before, and hold there


class Stops(Strict):
    """One policy per reason to stop.

    ``hold`` keeps the position, ``rest`` moves to the rest pose, ``relax`` cuts torque, ``vent`` releases
    pressure.

    Attributes:
        on_end: the trajectory ended.
        on_interrupt: the first Ctrl-C, SIGTERM, a closed terminal, or a stop over the socket.
        on_fault: a fault stopped the robot.
        on_host_loss: the daemon process died.
        estop: the second Ctrl-C, or `contid estop`; no motion before it.
    """

    on_end: StopPolicy = StopPolicy.HOLD
    on_interrupt: StopPolicy = StopPolicy.HOLD
    on_fault: Literal[StopPolicy.HOLD, StopPolicy.RELAX, StopPolicy.VENT] = StopPolicy.HOLD
    on_host_loss: Literal[StopPolicy.HOLD, StopPolicy.RELAX, StopPolicy.VENT] = StopPolicy.RELAX
    estop: Literal[StopPolicy.RELAX, StopPolicy.VENT] = StopPolicy.RELAX


class TipFeedback(Strict):
    """Closed loop on the tip: measured tip positions correct the error of the model.

    Attributes:
        gain_per_s: gain of the estimate of the model's error; its time constant is the inverse.
        limit_mm: maximum correction; a larger error means a wrong measurement or a wrong model.
        stale_ms: time without a measurement after which the correction fades.
        fade_ms: duration of the fade; with ``stale_ms`` at most one second.
    """

    gain_per_s: Annotated[float, Field(gt=0, le=50)] = 5.0
    limit_mm: Positive = 20.0
    stale_ms: Annotated[float, Field(gt=0, le=500)] = 200.0
    fade_ms: Annotated[float, Field(gt=0, le=500)] = 500.0


class AxisDescription(BaseModel):
    """One axis of a robot: its bus and its transmission; further keys belong to the driver of the bus.

    The transmission maps the model's length or pressure to the device's angle or pressure. Pressures on
    regulators need none.

    Attributes:
        bus: name of its bus.
        mm_per_rev: a pinion or spool on a rotary device:
            ``angle = zero_deg + direction * 360 * length / mm_per_rev``.
        zero_deg: the device's angle at length 0.
        direction: sense of rotation that makes the length grow.
        mm_to_bar: for lengths driven by regulators: rows ``[length_mm, pressure_bar]``, strictly monotone,
            interpolated by a monotone cubic.
        follow_delay_ms: its longest dead time when it is healthy; that of the robot if left out.
        follow_lag_ms: longest time constant of its answer behind that; likewise.
        follow_least_delay_ms: its shortest dead time, 0 if left out.
        follow_least_lag_ms: shortest time constant behind that, 0 if left out; an axis ahead of it is a
            fault, as when its device returns commands as measurements.
    """

    model_config = ConfigDict(extra="allow", frozen=True, allow_inf_nan=False)

    bus: str
    mm_per_rev: Size | None = None
    zero_deg: float = 0.0
    direction: Literal[1, -1] = 1
    mm_to_bar: tuple[tuple[float, float], ...] | None = None
    follow_delay_ms: NonNegative | None = None
    follow_lag_ms: Positive | None = None
    follow_least_delay_ms: NonNegative = 0.0
    follow_least_lag_ms: NonNegative = 0.0
