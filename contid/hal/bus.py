"""A bus and what it carries: axes, samples, findings, rest states, the clock."""

from __future__ import annotations

import enum
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Protocol, runtime_checkable

from contid.hal.homing import UNKNOWN, Reference
from contid.records import record

if TYPE_CHECKING:
    from pydantic import BaseModel


class Rest(enum.StrEnum):
    """State of rest of a device that is no longer commanded."""

    HOLD = "hold"
    RELAX = "relax"
    VENT = "vent"


class DeviceKind(enum.StrEnum):
    """Kind of actuator; determines its unit and its simulated device."""

    SERVO = "servo"  # rad
    MOTOR = "motor"  # rad
    REGULATOR = "regulator"  # Pa


@dataclass(frozen=True, slots=True)
class SpooledTendon:
    """A tendon on the spool of an axis, and the backbone it bends together with the others; for emulators.

    A section of the backbone has two bends, the components of its bend ``theta (cos phi, sin phi)`` about two
    axes (`contid.kinematics.tendon.geometry`).

    Attributes:
        stiffness_nm: torque of the tendon per angle wound in [N m/rad].
        bends: angle wound in by each bend of the backbone, with the sign of the device's rotation [rad/rad];
            section by section from the base, the two of a section one after the other.
        bending_nm: stiffness of each bend, in the order of ``bends`` [N m/rad].
        backlash_rad: half width of the backlash between spool and tendon.
        capstan: coefficient of friction in each section, half as many as ``bends``; empty: none.
    """

    stiffness_nm: float
    bends: tuple[float, ...]
    bending_nm: tuple[float, ...]
    backlash_rad: float = 0.0
    capstan: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class AxisOnBus:
    """One axis as passed to its driver.

    Attributes:
        name: unique in the robot file, ``ROBOT.AXIS``.
        options: the driver's own validated options of this axis (id, channel, ...).
        travel: min and max device value [rad or Pa] allowed by the robot file, or None.
        tendon: the tendon that its device winds up; None for robots without tendons.
        reference: what homing of this axis must agree with.
    """

    name: str
    options: BaseModel
    travel: tuple[float, float] | None = None
    tendon: SpooledTendon | None = None
    reference: Reference = UNKNOWN


#: A `Sample.fault` that begins with one of these gets a fault number of its own (docs/faults.md).
SLACK_TENDON: Final = "slack tendon"
SNAPPED_TENDON: Final = "snapped tendon"


#: Parts of a `Sample` that a device need not report.
REPORTED: Final = ("velocity", "effort", "temperature_c", "voltage_v", "tension_n")


@record(frozen=True, slots=True)
class Sample:
    """The state of one axis.

    Attributes:
        value: position [rad] or pressure [Pa]; None before the first valid read.
        time_s: when ``value`` was measured, on the clock of the bus.
        valid: True when the newest exchange read this axis successfully.
        age_s: time since ``time_s`` at the end of the newest exchange.
        velocity: [rad/s] or [Pa/s] when the device reports it.
        effort: current [A] for motors and servos, duty [0..1] for regulators, when reported.
        temperature_c: [deg C] when reported.
        voltage_v: supply [V] when reported.
        fault: the device's own fault as text, "" without one.
        tension_n: of the tendon at a load cell [N], when measured.
    """

    value: float | None
    time_s: float
    valid: bool
    age_s: float
    velocity: float | None = None
    effort: float | None = None
    temperature_c: float | None = None
    voltage_v: float | None = None
    fault: str = ""
    tension_n: float | None = None


@dataclass(frozen=True, slots=True)
class Finding:
    """One line of a ``doctor`` report.

    Attributes:
        subject: what was examined, such as a port or an axis.
        ok: False when a person must do something before the robot can run.
        message: what was found.
        remedy: what to do.
        warning: True for a finding that is ``ok`` with a restriction, or that arming corrects.
    """

    subject: str
    ok: bool
    message: str
    remedy: str = ""
    warning: bool = False


class Clock(Protocol):
    """The clock of a bus: the monotonic clock, or a virtual one in tests and replay."""

    def now(self) -> float:
        """Seconds since an arbitrary origin."""

    def sleep(self, seconds: float) -> None:
        """Wait; a virtual clock advances, so a slow bus delays the tick in virtual time as well."""


@runtime_checkable
class Bus(Protocol):
    """A set of axes on one line; not thread-safe."""

    name: str
    axes: tuple[str, ...]

    def open(self) -> None:
        """Connect, and check that the devices of the robot file answer.

        Raises:
            DeviceNotFoundError: the port or a device is missing, or differs from the robot file; the message
                lists expected and found.
        """

    def enable(self, axes: Sequence[str]) -> None:
        """Make axes ready to move without moving them: goal := present, torque on, watchdog armed."""

    def exchange(self, commands: Mapping[str, float]) -> Mapping[str, Sample]:
        """Send the commands of a tick, and read every axis.

        Args:
            commands: device values [rad or Pa] by axis name; axes left out keep their goal.

        Returns:
            One sample per axis of the bus, in the order of `axes`.

        Raises:
            DeviceLostError: the whole bus is gone.
        """

    def disable(self, axes: Sequence[str], rest: Rest) -> None:
        """Bring axes to a state of rest; does not raise for a lost device.

        A rest stays asked for until its device confirms it, also over a loss of the bus: `exchange` asks
        again when it answers, unless `enable` has made it ready meanwhile.
        """

    def clear_fault(self, axes: Sequence[str]) -> None:
        """Clear latched device faults without motion; raises `DeviceError` if one persists."""

    def close(self) -> None:
        """Close the port. Idempotent; never changes torque."""


@runtime_checkable
class LimitsEffort(Protocol):
    """A bus with devices that push with a limited effort, changeable while they move."""

    def effort_limits(self) -> Mapping[str, float]:
        """Greatest effort [A] of every axis that can be limited, by the robot file."""

    def limit_effort(self, shares: Mapping[str, float]) -> None:
        """Limit axes to a share (0 to 1) of their greatest effort, from the next exchange on."""


@dataclass(frozen=True, slots=True)
class TipMeasured:
    """A tip that a tracker measured.

    Attributes:
        robot: its name.
        tip_in_world_m: position [m].
        time_s: when it was captured, on the clock of the bus.
    """

    robot: str
    tip_in_world_m: tuple[float, float, float]
    time_s: float


@runtime_checkable
class MeasuresTips(Protocol):
    """A bus with a tracker of the tips of its robots; they arrive as those of any tracker."""

    def measured_tips(self) -> Sequence[TipMeasured]:
        """What arrived since the last call, in the order of time; callable from any thread."""


@runtime_checkable
class SimulatesBodies(Protocol):
    """A simulated bus that computes where the tips of its robots are."""

    def carry(self, robot: str, description: BaseModel) -> None:
        """Simulate the body of a robot whose axes it carries; called before `Bus.open`.

        Args:
            robot: its name.
            description: a `contid.robot_file.robot.RobotDescription`, which this layer does not import.
        """


@runtime_checkable
class CountsAnswers(Protocol):
    """A bus that counts what went wrong on its wire; the report of a run prints the counts."""

    def answer_counts(self) -> Mapping[str, int]:
        """Counts since the bus was built, by what is counted: ``exchanges``, ``late``, ``silent``."""
