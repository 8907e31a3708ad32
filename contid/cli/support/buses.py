"""The buses of a robot file with their drivers and axes, for the commands that talk to devices directly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

from contid.control.tick.transmission import RobotTransmission
from contid.errors import ContidError
from contid.hal import AxisOnBus, Driver, load_driver
from contid.robot_file.load import BusWiring, LoadedFile

_Capability = TypeVar("_Capability")


@dataclass(frozen=True, slots=True)
class WiredBus:
    """One bus with axes, and its driver."""

    wiring: BusWiring
    driver: Driver
    axes: tuple[AxisOnBus, ...]

    def capable(self, capability: type[_Capability], command: str) -> _Capability:
        """The driver, as one with an optional capability.

        Raises:
            ContidError: the driver lacks it.
        """
        if not isinstance(self.driver, capability):
            raise ContidError(
                f"bus {self.wiring.name}: driver {self.wiring.driver!r} cannot `contid {command}`"
            )
        return self.driver


def wired_buses(loaded: LoadedFile) -> list[WiredBus]:
    """Every bus of a file that has axes, in file order."""
    travel: dict[str, tuple[float, float]] = {}
    for name, robot in loaded.file.robots.items():
        if not robot.passive:
            ranges = RobotTransmission(robot).travel()
            travel |= {
                f"{name}.{axis}": ends for axis, ends in zip(robot.all_axis_names, ranges, strict=True)
            }
    return [
        WiredBus(
            wiring,
            load_driver(wiring.driver),
            tuple(AxisOnBus(axis, options, travel.get(axis)) for axis, options in wiring.axes),
        )
        for wiring in loaded.buses.values()
        if wiring.axes
    ]
