"""Buses of one file that would open one device."""

from __future__ import annotations

import glob
import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from contid.errors import Located
from contid.robot_file.document import BusWiring
from contid.robot_file.positions import Document


def check_ports(document: Document, buses: Iterable[BusWiring]) -> Iterator[Located]:
    """Refuse a bus whose port is the device of an earlier one, by the same or another name."""
    owners: dict[str, BusWiring] = {}
    for bus in buses:
        port = getattr(bus.options, "port", None)
        if not isinstance(port, str):
            continue
        owner = owners.setdefault(_device(port), bus)
        if owner is not bus:
            message = f"port: {port} is the device of bus {owner.name} as well; a device is one bus"
            yield document.at_value(("buses", bus.name, "port"), message)


def _device(port: str) -> str:
    """The device behind a path or a glob, links followed; the path itself while it does not exist."""
    path = str(Path(port).expanduser())
    found = glob.glob(path)  # noqa: PTH207  # an absolute pattern has no Path to start from
    return os.path.realpath(found[0] if len(found) == 1 else path)
