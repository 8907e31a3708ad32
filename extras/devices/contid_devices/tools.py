"""What is done with the devices of a driver beside a run: search, diagnosis, commissioning.

The interfaces are those of `contid.hal.optional`. A driver has them itself, or an object of the entry points
``contid.tools`` has them for it, under the driver's name.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

from contid import entry_points
from contid.errors import ContidError
from contid.hal import load_driver

if TYPE_CHECKING:
    from contid.control.engine.wiring import WiredBus

_Tool = TypeVar("_Tool")


def find_tool(driver: str, interface: type[_Tool]) -> _Tool | None:
    """The object that has an interface for a driver; None where nothing has it.

    Raises:
        UnknownDriverError: no such driver.
    """
    for each in (load_driver(driver), entry_points.load_one(entry_points.TOOLS, driver)):
        if isinstance(each, interface):
            return each
    return None


def require_tool(bus: WiredBus, interface: type[_Tool], command: str) -> _Tool:
    """The object that has an interface for the driver of a bus.

    Raises:
        ContidError: nothing has it, so ``contid COMMAND`` is impossible for this bus.
    """
    found = find_tool(bus.wiring.driver, interface)
    if found is None:
        raise ContidError(f"bus {bus.wiring.name}: driver {bus.wiring.driver!r} cannot `contid {command}`")
    return found
