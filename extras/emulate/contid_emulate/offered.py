"""What emulates the devices of a bus: an entry point by the name of its driver, else the driver itself."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING

from contid import entry_points
from contid.hal import Emulates

if TYPE_CHECKING:
    from contid.control.engine.wiring import WiredBus


def emulated(bus: WiredBus, control: Path | None) -> AbstractContextManager[Sequence[str]]:
    """Devices of a bus on the wire while the context lasts.

    Args:
        bus: of a robot file.
        control: file of fault switches, see `contid.hal.Emulates.emulator`.

    Raises:
        ContidError: nothing emulates what this driver drives.
    """
    emulator = entry_points.load_one(entry_points.EMULATORS, bus.wiring.driver)
    if emulator is None:
        emulates = bus.capable(Emulates, "emulate")  # type: ignore[type-abstract]  # a runtime protocol
        emulator = emulates.emulator
    found: AbstractContextManager[Sequence[str]] = emulator(
        bus.wiring.name, bus.wiring.options, bus.axes, control
    )
    return found
