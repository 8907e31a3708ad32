"""Example of an external driver: a box of winches on the network, which exists only as an emulator.

The entry point names this module. Every command that reads ``driver: winch`` in a robot file imports it, so
it holds the keys of the file only; modules that connect to the box are imported on use.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Annotated, Any, Final

from pydantic import BaseModel, Field

from contid.errors import ContidError, DeviceError
from contid.hal import AxisOnBus, Bus, Clock, DeviceKind, Driver, Finding
from contid.robot_file.base import Strict


class BusOptions(Strict):
    """Keys of ``buses.NAME`` with ``driver: winch``.

    Attributes:
        address: of the box on the network, ``HOST:PORT``.
        watchdog_ms: watchdog of the box: every drum stops after this time without an exchange.
        reply_ms: time-out of an answer.
    """

    address: Annotated[str, Field(pattern=r"^[^:]+:[0-9]+$")]
    watchdog_ms: Annotated[int, Field(ge=20, le=5000)] = 100
    reply_ms: Annotated[float, Field(gt=0, le=200)] = 5.0

    @property
    def host_and_port(self) -> tuple[str, int]:
        """The address as sockets take it."""
        host, _, port = self.address.rpartition(":")
        return host, int(port)


class AxisOptions(Strict):
    """Keys of an axis on a winch box.

    Attributes:
        drum: number of its drum on the box.
        steps_per_rev: microsteps per turn of the drum.
    """

    drum: Annotated[int, Field(ge=1, le=8)]
    steps_per_rev: Annotated[int, Field(ge=4, le=1_000_000)] = 3200


class WinchDriver:
    """See `contid.hal.Driver`; `emulator` and `doctor` make it one that `Emulates` and `Diagnoses`, too."""

    bus_options: type[BaseModel] = BusOptions
    axis_options: type[BaseModel] = AxisOptions

    def kind(self, axis: BaseModel) -> DeviceKind:
        """A drum turns: its values are angles [rad]."""
        return DeviceKind.MOTOR

    def address(self, axis: BaseModel) -> str:
        """No two axes of one box may name the same drum."""
        assert isinstance(axis, AxisOptions)
        return f"drum {axis.drum}"

    def mock_options(self, bus: BaseModel) -> Mapping[str, Any]:
        """See `contid.hal.Driver`; ``--mock`` keeps the watchdog time."""
        assert isinstance(bus, BusOptions)
        return {"watchdog_ms": bus.watchdog_ms}

    def mock_axis_options(self, axis: BaseModel) -> Mapping[str, Any]:
        """A simulated motor with steps of the same size."""
        assert isinstance(axis, AxisOptions)
        return {"device": DeviceKind.MOTOR.value, "counts_per_rev": axis.steps_per_rev}

    def open_bus(self, name: str, options: BaseModel, axes: Sequence[AxisOnBus], clock: Clock) -> Bus:
        """Build the bus; touches nothing."""
        from contid_winch.bus import WinchBus

        assert isinstance(options, BusOptions)
        return WinchBus(name, options, axes, clock)

    def emulator(
        self, name: str, options: BaseModel, axes: Sequence[AxisOnBus], control: Path | None = None
    ) -> AbstractContextManager[Sequence[str]]:
        """See `contid.hal.Emulates`."""
        from contid_winch.emulator import emulated

        assert isinstance(options, BusOptions)
        if control is not None:
            raise ContidError(f"bus {name}: the emulated winch box takes no file of faults")
        return emulated(options, axes)

    def doctor(self, name: str, options: BaseModel, axes: Sequence[AxisOnBus]) -> list[Finding]:
        """See `contid.hal.Diagnoses`: whether the box and every drum answer."""
        from contid_winch.link import Link

        assert isinstance(options, BusOptions)
        try:
            Link(name, options, axes).close()
        except DeviceError as error:
            return [Finding(name, False, error.message, error.remedy)]
        return [Finding(name, True, f"the box answers, and so do {', '.join(axis.name for axis in axes)}")]


DRIVER: Final[Driver] = WinchDriver()
