"""Optional interfaces of drivers; commands test for them with ``isinstance(driver, Emulates)``."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, Protocol, TypeAlias, runtime_checkable

from contid.hal.bus import AxisOnBus, Finding

if TYPE_CHECKING:
    from pydantic import BaseModel

#: Takes one line about the progress of a slow operation.
Report: TypeAlias = Callable[[str], None]


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
        least_s: time of the bytes on the wire in the fastest form; a shorter period is impossible.
        most_s: time without faults, in the slowest form and with a slow adapter.
        what: description of what both were computed from.
    """

    least_s: float
    most_s: float
    what: str


@runtime_checkable
class Paces(Protocol):
    """Computes how long an exchange takes: ``contid check``, ``contid doctor``."""

    def exchange_time(self, options: BaseModel, axes: Sequence[BaseModel]) -> ExchangeTime:
        """Time of one exchange with every axis of a bus."""


class RefusedKey(NamedTuple):
    """A key of a bus whose value does not go with its other options or its axes, and why."""

    key: str
    message: str


@runtime_checkable
class Restricts(Protocol):
    """Refuses some combinations of valid bus options and valid axes: ``contid check``, ``contid run``."""

    def refused(self, options: BaseModel, axes: Sequence[tuple[str, BaseModel]]) -> Iterator[RefusedKey]:
        """Everything that is refused; ``axes`` are names and options."""


@dataclass(frozen=True, slots=True)
class DeviceRate:
    """The fastest demands a device follows, and how far and how finely it turns.

    Attributes:
        key: key of the axis in the robot file that sets it.
        value: the rate [rad/s or Pa/s].
        what: what it is, where the key does not hold the rate itself.
        acceleration: the greatest acceleration of demands that it follows [rad/s^2 or Pa/s^2].
        acceleration_key: key of the axis that sets that.
        reach: the greatest angle to either side that it can be sent to [rad].
        step: one step of its encoder [rad].
    """

    key: str
    value: float
    what: str = ""
    acceleration: float = math.inf
    acceleration_key: str = ""
    reach: float = math.inf
    step: float = 0.0


@runtime_checkable
class LimitsRate(Protocol):
    """Has devices that follow faster demands late, and do not report it: ``contid check``, ``contid run``."""

    def device_rate(self, axis: BaseModel) -> DeviceRate:
        """Limit of the device of an axis with these options."""


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
        """True for options of an axis that can be parked."""

    def park(
        self, name: str, options: BaseModel, axes: Sequence[AxisOnBus], only: Sequence[str], report: Report
    ) -> None:
        """Take the present pose of the axes ``only`` as their parked pose; moves nothing.

        Raises:
            DeviceError: an axis cannot be parked, or is under power.
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
        """Restore the factory value of every setting but id and baud rate."""

    def setup(
        self,
        name: str,
        options: BaseModel,
        axes: Sequence[AxisOnBus],
        ask: Callable[[str], None],
        report: Report,
    ) -> None:
        """Give the devices of a bus the ids of the robot file, one device after the other.

        Args:
            name: the bus.
            options: the bus's own options.
            axes: its axes.
            ask: shows a request, such as to connect one device, and returns when the person has done it.
            report: takes lines about the progress.
        """
