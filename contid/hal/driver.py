"""A driver: options and a factory of buses; found by its entry point."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.metadata import EntryPoint, entry_points
from typing import TYPE_CHECKING, Any, Final, Protocol, TypeVar, runtime_checkable

from contid.entry_points import TOOLS, load_one
from contid.errors import ContidError
from contid.hal.bus import AxisOnBus, Bus, Clock, DeviceKind
from contid.hal.optional import Report

if TYPE_CHECKING:
    from pydantic import BaseModel

_Tool = TypeVar("_Tool")

ENTRY_POINT_GROUP: Final = "contid.drivers"

#: Drivers of this distribution; found without installed metadata, as in a checkout on PYTHONPATH.
BUILT_IN: Final[dict[str, str]] = {
    "sim": "contid_drivers.sim:DRIVER",
    "dynamixel": "contid_drivers.dynamixel:DRIVER",
    "due": "contid_drivers.due:DRIVER",
}


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


@runtime_checkable
class Identifies(Protocol):
    """A driver that refuses other devices than those a bus had before: ``contid doctor --accept``."""

    def accept(self, name: str, options: BaseModel, axes: Sequence[AxisOnBus], report: Report) -> None:
        """Take the devices that answer as those of the bus from now on; moves nothing.

        Raises:
            DeviceError: one does not answer, or cannot be marked.
        """


class UnknownDriverError(ContidError):
    """The robot file names a driver that is not installed, or cannot be imported."""


def driver_names() -> tuple[str, ...]:
    """Names of all drivers: built-in ones, then installed plug-ins."""
    installed = {point.name for point in entry_points(group=ENTRY_POINT_GROUP)}
    return (*BUILT_IN, *sorted(installed - set(BUILT_IN)))


def load_driver(name: str) -> Driver:
    """Import a driver by name.

    Raises:
        UnknownDriverError: no such driver, or one that cannot be imported.
    """
    if name in BUILT_IN:
        point = EntryPoint(name, BUILT_IN[name], ENTRY_POINT_GROUP)
    else:
        found = [point for point in entry_points(group=ENTRY_POINT_GROUP) if point.name == name]
        if not found:
            raise UnknownDriverError(f"unknown driver {name!r}; available: {', '.join(driver_names())}")
        point = found[0]
    try:
        driver: Driver = point.load()
    except Exception as error:
        why = f"driver {name!r} cannot be imported from {point.value}: {type(error).__name__}: {error}"
        raise UnknownDriverError(f"{why}; install its package again, or remove it") from error
    return driver


def find_tool(name: str, driver: Driver, interface: type[_Tool]) -> _Tool | None:
    """The object with an optional interface for the driver of this name; None where nothing has it.

    It is the driver itself, or what the entry points ``contid.tools`` have under its name.
    """
    if isinstance(driver, interface):
        return driver
    tool = load_one(TOOLS, name)
    return tool if isinstance(tool, interface) else None
