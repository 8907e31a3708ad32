"""What a bus is and what a sample is: the one contract every driver keeps.

A bus carries axes. Values at this boundary are SI and belong to the *device*: the angle of an output shaft
in rad for servos and geared motors, a pressure in Pa for regulators. How a length becomes an angle is the
transmission's business, how an angle becomes ticks is the driver's.

Life of a bus::

    bus = driver.open_bus(name, options, axes)   # nothing is touched yet
    bus.open()                                   # handshake; never moves, never changes torque
    bus.exchange({})                             # reads only, until every axis has a valid sample
    bus.enable(axes)                             # goal := present, then torque, then the device's dead-man
    bus.exchange({axis: value, ...})             # one tick; feeds the dead-man
    bus.disable(axes, Rest.RELAX)                # the device's own safe state
    bus.close()                                  # idempotent; never touches torque

Rules (the contract suite in ``tests/contract`` holds every bus to them):

* no command is sent to an axis that is not enabled: such commands are dropped and the others go out, so an
  axis whose device disarmed itself costs nobody else; its sample says why;
* a command that is not finite, or names no axis of the bus, is refused with `DeviceError` before anything of
  that tick is sent;
* `enable` is all or nothing, leaves axes alone that are enabled already, and raises `DeviceError` for an
  axis that is silent or in a latched fault;
* a failed read is never a number: the sample keeps the last good value, its time, ``valid=False``;
* a lost device raises `DeviceLostError` out of `exchange` within one call, and every call after that too,
  until `open` succeeds again; an axis that is silent alone shows as ``valid=False`` and costs nobody else;
* only a completed `exchange` feeds the dead-man of the devices; a tripped one is latched: the axis rests,
  ignores commands and names the trip in ``fault`` until `clear_fault`, then it needs `enable` again;
* `open`, `disable` and `close` may be called in any state and twice.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol, TypeAlias, runtime_checkable

from contid.errors import ContidError

if TYPE_CHECKING:
    from pydantic import BaseModel

ENTRY_POINT_GROUP: Final = "contid.drivers"

#: Takes one line about the progress of something slow.
Say: TypeAlias = Callable[[str], None]

#: Drivers of this distribution, found without installed metadata (a checkout on PYTHONPATH works too).
BUILT_IN: Final[dict[str, str]] = {
    "sim": "contid_drivers.sim:DRIVER",
    "dynamixel": "contid_drivers.dynamixel:DRIVER",
    "due": "contid_drivers.due:DRIVER",
}


class Rest(enum.StrEnum):
    """What a device does once nobody commands it."""

    HOLD = "hold"
    RELAX = "relax"
    VENT = "vent"


class DeviceKind(enum.StrEnum):
    """Kinds of actuator; decides the unit at this boundary and the simulated twin."""

    SERVO = "servo"  # rad
    MOTOR = "motor"  # rad
    REGULATOR = "regulator"  # Pa


@dataclass(frozen=True, slots=True)
class AxisOnBus:
    """One axis as its driver sees it.

    Attributes:
        name: unique in the robot file, ``ROBOT.AXIS``.
        options: the driver's own validated options of this axis (id, channel, ...).
        travel: least and greatest device value [rad or Pa] the robot file allows, or None when open.
    """

    name: str
    options: BaseModel
    travel: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class Sample:
    """What one axis reported.

    Attributes:
        value: position [rad] or pressure [Pa]; None only while nothing valid was ever read.
        time_s: when ``value`` was measured, on the clock given to the bus.
        valid: True when the newest exchange read this axis successfully.
        age_s: time since ``time_s`` at the end of the newest exchange.
        velocity: [rad/s] or [Pa/s] when the device reports it.
        effort: current [A] for motors and servos, duty [0..1] for regulators, when reported.
        temperature_c: [deg C] when reported.
        voltage_v: supply [V] when reported.
        fault: the device's own fault in words, "" while there is none.
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


@dataclass(frozen=True, slots=True)
class Finding:
    """One line of a ``doctor`` report: what was looked at, whether it is well, and the remedy."""

    subject: str
    ok: bool
    message: str
    remedy: str = ""


class Clock(Protocol):
    """Where a bus gets the time from: the real monotonic clock, or a virtual one in tests and replay."""

    def now(self) -> float:
        """Seconds; only differences mean anything."""
        ...

    def sleep(self, seconds: float) -> None:
        """Let time pass; a virtual clock just moves on, so a late bus makes a late tick there as well."""
        ...


@runtime_checkable
class Bus(Protocol):
    """A set of axes behind one wire. Not thread-safe: one owner calls it."""

    name: str
    axes: tuple[str, ...]

    def open(self) -> None:
        """Connect and shake hands.

        Raises:
            DeviceNotFoundError: the port or a device is missing, or is not what the robot file says; the
                message lists expected against found.
        """
        ...

    def enable(self, axes: Sequence[str]) -> None:
        """Make axes ready to move without moving them: goal := present, torque on, dead-man armed."""
        ...

    def exchange(self, commands: Mapping[str, float]) -> Mapping[str, Sample]:
        """One tick: send the commands of this tick, read every axis.

        Args:
            commands: device values [rad or Pa] by axis name; axes left out keep their goal.

        Returns:
            One sample per axis of the bus, in the order of `axes`.

        Raises:
            DeviceLostError: the whole bus is gone.
        """
        ...

    def disable(self, axes: Sequence[str], rest: Rest) -> None:
        """Bring axes to a state of rest now; best effort, never raises for a lost device."""
        ...

    def clear_fault(self, axes: Sequence[str]) -> None:
        """Clear latched device faults without moving anything; raises `DeviceError` if one persists."""
        ...

    def close(self) -> None:
        """Let the port go. Idempotent; never changes torque."""
        ...


class Driver(Protocol):
    """What an entry point of the group ``contid.drivers`` names: options and a factory, imported lightly."""

    #: Validated options of a bus (``buses.NAME`` without ``driver``) and of an axis (``bus`` and the common
    #: keys removed). Both forbid unknown keys.
    bus_options: type[BaseModel]
    axis_options: type[BaseModel]

    def kind(self, axis: BaseModel) -> DeviceKind:
        """The kind of actuator behind an axis with these options."""
        ...

    def address(self, axis: BaseModel) -> str:
        """What must be unique on one bus, in words: ``id 3``, ``channel m2``; "" when names suffice."""
        ...

    def mock_options(self, bus: BaseModel) -> Mapping[str, Any]:
        """Options of the ``sim`` bus that stands in for this bus under ``--mock``."""
        ...

    def mock_axis_options(self, axis: BaseModel) -> Mapping[str, Any]:
        """Options of the ``sim`` axis that stands in for this axis, at least ``{"device": KIND}``."""
        ...

    def open_bus(self, name: str, options: BaseModel, axes: Sequence[AxisOnBus], clock: Clock) -> Bus:
        """Build a bus; touches no device."""
        ...


@dataclass(frozen=True, slots=True)
class Homed:
    """What homing one axis found.

    Attributes:
        axis: ``ROBOT.AXIS``.
        value: the device's value at the reference [rad], on the scale `Sample.value` has from now on.
        at_mm: the actuator's length or travel at the reference, as the robot file says.
        how: how it was found, in words; it goes into the robot file beside the result.
    """

    axis: str
    value: float
    at_mm: float
    how: str


# What a driver may offer beyond `Driver`. A command looks the driver up and asks
# ``isinstance(driver, Emulates)``; a driver without the capability is named in the message.


@runtime_checkable
class Emulates(Protocol):
    """Has wire-level devices to stand in for hardware: ``contid emulate``."""

    def emulator(
        self, name: str, options: BaseModel, axes: Sequence[AxisOnBus], control: Path | None = None
    ) -> AbstractContextManager[Sequence[str]]:
        """The devices of one bus, alive at the port its options name for as long as the context lasts.

        Args:
            name: the bus.
            options: the bus's own options; a port that is no real device becomes a link to a pty.
            axes: its axes.
            control: file the emulator follows; each line appended is one fault switch in JSON.

        Returns:
            A context manager; entering gives lines for the user: what stands where.
        """
        ...


@runtime_checkable
class Diagnoses(Protocol):
    """Can look at a bus and its host and say what is wrong: ``contid doctor``."""

    def doctor(self, name: str, options: BaseModel, axes: Sequence[AxisOnBus]) -> list[Finding]:
        """Examine without moving anything; never raises for what it finds, it reports it."""
        ...


@runtime_checkable
class Homes(Protocol):
    """Can find the reference of its axes: ``contid home``."""

    def home(
        self, name: str, options: BaseModel, axes: Sequence[AxisOnBus], only: Sequence[str], say: Say
    ) -> list[Homed]:
        """Move axes to their reference, one after the other, and leave them at rest.

        Args:
            name: the bus.
            options: the bus's own options.
            axes: every axis of the bus, homed or not.
            only: names of the axes to home.
            say: takes a line about the progress.

        Raises:
            DeviceError: an axis has no homing method, or its reference was not found; nothing of it may be
                written then.
        """
        ...


@dataclass(frozen=True, slots=True)
class FoundDevice:
    """A device that answered a scan: where, at which baud rate, its address there, and what it says it is."""

    port: str
    baud: int
    address: int
    model: str
    firmware: int


@runtime_checkable
class Scans(Protocol):
    """Can look for its devices without a robot file: ``contid scan``."""

    def scan(self, ports: Sequence[str], bauds: Sequence[int], say: Say) -> list[FoundDevice]:
        """Devices on ``ports`` (empty: every likely one) at ``bauds`` (empty: every possible one)."""
        ...


@runtime_checkable
class Commissions(Protocol):
    """Can give a single device its id and baud rate: ``contid servo``.

    Every method raises `DeviceError` when the device is silent, under torque, or refuses.
    """

    def set_id(self, port: str, baud: int, device: int, new: int) -> None:
        """Give a device another id."""
        ...

    def set_baud(self, port: str, baud: int, device: int, new: int) -> None:
        """Give a device another baud rate."""
        ...

    def reboot(self, port: str, baud: int, device: int) -> None:
        """Restart a device; its torque is off then."""
        ...


class UnknownDriverError(ContidError):
    """The robot file names a driver that is not installed."""


def driver_names() -> tuple[str, ...]:
    """Every driver that can be named in a robot file: the built-in ones, then installed plug-ins."""
    installed = {point.name for point in entry_points(group=ENTRY_POINT_GROUP)}
    return (*BUILT_IN, *sorted(installed - set(BUILT_IN)))


def load_driver(name: str) -> Driver:
    """Import the driver called ``name``; only a robot file that names it pays for the import.

    Raises:
        UnknownDriverError: no such driver; the message lists those there are.
    """
    from importlib import import_module
    from importlib.metadata import EntryPoint

    if name in BUILT_IN:
        point = EntryPoint(name, BUILT_IN[name], ENTRY_POINT_GROUP)
    else:
        found = [point for point in entry_points(group=ENTRY_POINT_GROUP) if point.name == name]
        if not found:
            raise UnknownDriverError(f"no driver {name!r}; there are {', '.join(driver_names())}")
        point = found[0]
    module = import_module(point.module)
    driver: Driver = getattr(module, point.attr)
    return driver
