"""The hardware abstraction layer: the interface of drivers, buses and samples.

A bus carries axes. Values at this boundary are SI and belong to the *device*: the angle of an output shaft
in rad for servos and geared motors, a pressure in Pa for regulators. The transmission converts lengths to
angles, the driver angles to ticks.

Life of a bus::

    bus = driver.open_bus(name, options, axes)   # accesses no device
    bus.open()                                   # handshake; never moves, never changes torque
    bus.exchange({})                             # reads only, until every axis has a valid sample
    bus.enable(axes)                             # goal := present, then torque, then the device's watchdog
    bus.exchange({axis: value, ...})             # one tick; refreshes the watchdog
    bus.disable(axes, Rest.RELAX)                # the device's own state of rest
    bus.close()                                  # idempotent; never touches torque

Rules (``tests/contract`` checks every bus against them):

* no command is sent to an axis that is not enabled: such commands are dropped and the others are sent;
  the sample of an axis whose device disarmed itself holds the reason;
* a command that is not finite, or names no axis of the bus, is refused with `DeviceError` before anything of
  that tick is sent;
* `enable` is all or nothing, does not affect axes that are enabled already, and raises `DeviceError` for an
  axis that is silent or in a latched fault;
* after a failed read the sample keeps the last good value and its time, with ``valid=False``;
* a lost device raises `DeviceLostError` out of `exchange` within one call, and every call after that too,
  until `open` succeeds again; a single silent axis has ``valid=False`` and does not affect the others;
* only a completed `exchange` refreshes the watchdog of the devices; a trip is latched: the axis rests,
  ignores commands and reports the trip in ``fault`` (with the word ``watchdog``) until `clear_fault`, then it
  needs `enable` again;
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

#: Takes one line about the progress of a slow operation.
Report: TypeAlias = Callable[[str], None]

#: Drivers of this distribution; found without installed metadata, as in a checkout on PYTHONPATH.
BUILT_IN: Final[dict[str, str]] = {
    "sim": "contid_drivers.sim:DRIVER",
    "dynamixel": "contid_drivers.dynamixel:DRIVER",
    "due": "contid_drivers.due:DRIVER",
}


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
class AxisOnBus:
    """One axis as passed to its driver.

    Attributes:
        name: unique in the robot file, ``ROBOT.AXIS``.
        options: the driver's own validated options of this axis (id, channel, ...).
        travel: min and max device value [rad or Pa] allowed by the robot file, or None.
    """

    name: str
    options: BaseModel
    travel: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
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
    """One line of a ``doctor`` report.

    Attributes:
        ok: False when a person must do something before the robot can run.
        remedy: what to do.
        warning: ``ok``, but with a restriction, or only after arming has changed it.
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
        """Connect and shake hands.

        Raises:
            DeviceNotFoundError: the port or a device is missing, or differs from the robot file; the message
                lists expected and found.
        """

    def enable(self, axes: Sequence[str]) -> None:
        """Make axes ready to move without moving them: goal := present, torque on, watchdog armed."""

    def exchange(self, commands: Mapping[str, float]) -> Mapping[str, Sample]:
        """One tick: send the commands of this tick, read every axis.

        Args:
            commands: device values [rad or Pa] by axis name; axes left out keep their goal.

        Returns:
            One sample per axis of the bus, in the order of `axes`.

        Raises:
            DeviceLostError: the whole bus is gone.
        """

    def disable(self, axes: Sequence[str], rest: Rest) -> None:
        """Bring axes to a state of rest; does not raise for a lost device."""

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


class Driver(Protocol):
    """Object of an entry point in the group ``contid.drivers``: options and a factory; cheap to import."""

    #: Validated options of a bus (``buses.NAME`` without ``driver``) and of an axis (``bus`` and the common
    #: keys removed). Both forbid unknown keys.
    bus_options: type[BaseModel]
    axis_options: type[BaseModel]

    def kind(self, axis: BaseModel) -> DeviceKind:
        """The kind of actuator behind an axis with these options."""

    def address(self, axis: BaseModel) -> str:
        """Text that must be unique on one bus: ``id 3``, ``channel m2``; "" for none."""

    def mock_options(self, bus: BaseModel) -> Mapping[str, Any]:
        """Options of the ``sim`` bus that replaces this bus under ``--mock``."""

    def mock_axis_options(self, axis: BaseModel) -> Mapping[str, Any]:
        """Options of the ``sim`` axis that replaces this axis, at least ``{"device": KIND}``."""

    def open_bus(self, name: str, options: BaseModel, axes: Sequence[AxisOnBus], clock: Clock) -> Bus:
        """Build a bus; accesses no device."""


@dataclass(frozen=True, slots=True)
class Homed:
    """Result of homing one axis.

    Attributes:
        axis: ``ROBOT.AXIS``.
        value: the device's value at the reference [rad], on the scale of `Sample.value` after homing.
        at_mm: the actuator's length or travel at the reference, from the robot file.
        how: description of the method, written into the robot file.
    """

    axis: str
    value: float
    at_mm: float
    how: str


# Optional interfaces of drivers; commands test for them with ``isinstance(driver, Emulates)``.


@runtime_checkable
class Emulates(Protocol):
    """Emulates its devices on the wire: ``contid emulate``."""

    def emulator(
        self, name: str, options: BaseModel, axes: Sequence[AxisOnBus], control: Path | None = None
    ) -> AbstractContextManager[Sequence[str]]:
        """Emulate the devices of one bus at the port in its options.

        Args:
            name: the bus.
            options: the bus's own options; a port that does not exist becomes a link to a pty.
            axes: its axes.
            control: file of fault switches; each appended line is one switch in JSON.

        Returns:
            A context manager; entering it returns lines for the user about the ports.
        """


@dataclass(frozen=True, slots=True)
class ExchangeTime:
    """Time of one exchange of a bus.

    Attributes:
        least_s: bytes on the wire in the fastest form; a shorter period is impossible.
        most_s: without faults, in the slowest form and with a slow adapter.
        what: what it was computed from.
    """

    least_s: float
    most_s: float
    what: str


@runtime_checkable
class Paces(Protocol):
    """Computes how long an exchange takes: ``contid check``, ``contid doctor``."""

    def exchange_time(self, options: BaseModel, axes: Sequence[BaseModel]) -> ExchangeTime:
        """Time of one exchange with every axis of a bus."""


@runtime_checkable
class Diagnoses(Protocol):
    """Examines a bus and its host: ``contid doctor``."""

    def doctor(self, name: str, options: BaseModel, axes: Sequence[AxisOnBus]) -> list[Finding]:
        """Examine without motion; problems are findings, not exceptions."""


@runtime_checkable
class Homes(Protocol):
    """Finds the reference of its axes: ``contid home``."""

    def home(
        self, name: str, options: BaseModel, axes: Sequence[AxisOnBus], only: Sequence[str], report: Report
    ) -> list[Homed]:
        """Move axes to their reference one after the other; they rest afterwards.

        Args:
            name: the bus.
            options: the bus's own options.
            axes: every axis of the bus, homed or not.
            only: names of the axes to home.
            report: takes lines about the progress.

        Raises:
            DeviceError: an axis has no homing method, or its reference was not found; its result must not
                be saved.
        """


@runtime_checkable
class Parks(Protocol):
    """Has axes without homing, whose position is known only when parked: ``contid home --parked``."""

    def parkable(self, axis: BaseModel) -> bool:
        """Whether an axis with these options is one of them."""

    def park(
        self, name: str, options: BaseModel, axes: Sequence[AxisOnBus], only: Sequence[str], report: Report
    ) -> None:
        """Take the present pose of the axes ``only`` as their parked pose; moves nothing.

        Raises:
            DeviceError: an axis is no such axis, or is under power.
        """


@dataclass(frozen=True, slots=True)
class FoundDevice:
    """A device that answered a scan.

    Attributes:
        port: where it answered.
        baud: rate of its wire; 0 where there is none (USB).
        address: its id on the wire, or the unique id of its chip.
        model: what it is.
        firmware: version of its firmware.
    """

    port: str
    baud: int
    address: int | str
    model: str
    firmware: int | str


@runtime_checkable
class Scans(Protocol):
    """Finds its devices without a robot file: ``contid scan``."""

    def scan(self, ports: Sequence[str], bauds: Sequence[int], report: Report) -> list[FoundDevice]:
        """Devices on ``ports`` (empty: every likely one) at ``bauds`` (empty: all until one answers)."""


@dataclass(frozen=True, slots=True)
class RegisterValue:
    """A register of a device, its value in counts, and the unit of one count."""

    name: str
    address: int
    value: int
    unit: str


@runtime_checkable
class Commissions(Protocol):
    """Configures a single device: ``contid servo``.

    Every method raises `DeviceError` when the device is silent, under torque, or refuses.
    """

    def set_id(self, port: str, baud: int, device: int, new: int) -> None:
        """Change the id of a device."""

    def set_baud(self, port: str, baud: int, device: int, new: int) -> None:
        """Change the baud rate of a device."""

    def reboot(self, port: str, baud: int, device: int) -> None:
        """Restart a device; its torque is off afterwards."""

    def blink(self, port: str, baud: int, device: int, times: int) -> None:
        """Let the LED of a device blink."""

    def read_registers(self, port: str, baud: int, device: int, names: Sequence[str]) -> list[RegisterValue]:
        """Registers of a device by name; the usual ones without ``names``."""

    def write_register(self, port: str, baud: int, device: int, name: str, value: int) -> int:
        """Set a register that moves nothing; returns what it holds afterwards."""

    def factory_reset(self, port: str, baud: int, device: int) -> None:
        """Factory values of every setting but id and baud rate."""

    def setup(
        self,
        name: str,
        options: BaseModel,
        axes: Sequence[AxisOnBus],
        ask: Callable[[str], None],
        report: Report,
    ) -> None:
        """Number the devices of a bus as the robot file has them; ``ask`` waits for the person."""


class UnknownDriverError(ContidError):
    """The robot file names a driver that is not installed."""


def driver_names() -> tuple[str, ...]:
    """Names of all drivers: built-in ones, then installed plug-ins."""
    installed = {point.name for point in entry_points(group=ENTRY_POINT_GROUP)}
    return (*BUILT_IN, *sorted(installed - set(BUILT_IN)))


def load_driver(name: str) -> Driver:
    """Import a driver by name.

    Raises:
        UnknownDriverError: no such driver.
    """
    from importlib import import_module
    from importlib.metadata import EntryPoint

    if name in BUILT_IN:
        point = EntryPoint(name, BUILT_IN[name], ENTRY_POINT_GROUP)
    else:
        found = [point for point in entry_points(group=ENTRY_POINT_GROUP) if point.name == name]
        if not found:
            raise UnknownDriverError(f"unknown driver {name!r}; available: {', '.join(driver_names())}")
        point = found[0]
    module = import_module(point.module)
    driver: Driver = getattr(module, point.attr)
    return driver
