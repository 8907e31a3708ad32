"""Devices that answer now, compared with those of the bring-up: by ``doctor``, and before a run begins."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from typing import NamedTuple

from contid.control.engine.wiring import WiredBus, as_bus_error, wired_buses
from contid.errors import ContidError
from contid.hal.pulses import Proves
from contid.robot_file.edit import Change, edited
from contid.robot_file.load import LoadedFile, parse_robot_file
from contid.robot_file.proven.bringup import device_change

log = logging.getLogger(__name__)


class OtherDevice(NamedTuple):
    """An axis whose device or firmware is not that of its bring-up, as text."""

    axis: str
    change: str


def other_devices(loaded: LoadedFile, bus: WiredBus) -> Iterator[OtherDevice]:
    """Axes of a bus with another device or firmware than at their bring-up; opens the bus, moves nothing.

    Raises:
        ContidError: the bus cannot be opened, or its driver has a defect.
    """
    proven = loaded.file.bringup
    if isinstance(bus.driver, Proves) and any(axis.name in proven for axis in bus.axes):
        with as_bus_error(bus.wiring):
            devices = bus.driver.devices(bus.wiring.name, bus.wiring.options, bus.axes)
        for axis, device in devices.items():
            if axis in proven and (change := device_change(proven[axis], device)):
                yield OtherDevice(axis, change)


def with_other_devices(loaded: LoadedFile) -> LoadedFile:
    """The same file with ``bringup.AXIS.now`` of axes whose device was exchanged; their robots are slowed.

    It stands in the text as well, which recordings keep, so a replay plans as the run did.
    """
    section = {name: each.model_dump(exclude_defaults=True) for name, each in loaded.file.bringup.items()}
    found: list[OtherDevice] = []
    for bus in wired_buses(loaded) if section else []:
        try:
            found += other_devices(loaded, bus)
        except ContidError as error:
            log.warning("the devices of its bring-up cannot be compared now: %s", error)
    if not found:
        return loaded
    for axis, change in found:
        section[axis]["now"] = change
    return parse_robot_file(edited(loaded.text, [Change("bringup", section)]), str(loaded.path))
