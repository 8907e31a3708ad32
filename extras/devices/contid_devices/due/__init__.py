"""What is done with Due and Teensy boards beside a run; modules that touch a port are imported on use."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING

from contid.hal import AxisOnBus, Finding, FoundDevice, Homed, Report
from contid_devices.pulsed_motors import DriveFacts, PulsedBus
from contid_drivers.due.options import DueAxisOptions, DueBusOptions

if TYPE_CHECKING:
    from pydantic import BaseModel


class BoardTools:
    """Search, diagnosis, homing and pulses of boards (entry point ``contid.tools``)."""

    def doctor(self, name: str, options: BaseModel, axes: Sequence[AxisOnBus]) -> list[Finding]:
        """Examine without motion; problems are findings, not exceptions (`contid.hal.Diagnoses`)."""
        from contid_devices.due.board import doctor

        assert isinstance(options, DueBusOptions)
        return doctor(name, options, axes)

    def accept(self, name: str, options: BaseModel, axes: Sequence[AxisOnBus], report: Report) -> None:
        """Take the devices that answer as those of the bus (`contid.hal.Identifies`)."""
        from contid_devices.due.board import accept

        assert isinstance(options, DueBusOptions)
        accept(name, options, axes, report)

    def home(
        self, name: str, options: BaseModel, axes: Sequence[AxisOnBus], only: Sequence[str], report: Report
    ) -> list[Homed]:
        """See `contid.hal.Homes`; the board itself searches the end stops."""
        from contid_devices.due.homing import home

        assert isinstance(options, DueBusOptions)
        return home(name, options, axes, only, report)

    def parkable(self, axis: BaseModel) -> bool:
        """True for options of an axis that can be parked; motors without homing (`contid.hal.Parks`)."""
        assert isinstance(axis, DueAxisOptions)
        return axis.parkable

    def park(
        self, name: str, options: BaseModel, axes: Sequence[AxisOnBus], only: Sequence[str], report: Report
    ) -> None:
        """See `contid.hal.Parks`; the board counts from ``power_up_deg`` again."""
        from contid_devices.due.homing import park

        assert isinstance(options, DueBusOptions)
        park(name, options, axes, only, report)

    def pulsed_bus(
        self, name: str, options: BaseModel, axes: Sequence[AxisOnBus]
    ) -> AbstractContextManager[PulsedBus]:
        """Open the bus for pulses; on exit every motor is without power (see `Pulses`)."""
        from contid_devices.due.pulses import pulsed_bus

        assert isinstance(options, DueBusOptions)
        return pulsed_bus(name, options, axes)

    def drive_facts(self, axis: BaseModel) -> DriveFacts | None:
        """What the file states about the motor of an axis; None for a regulator."""
        from contid_devices.due.pulses import drive_facts

        assert isinstance(axis, DueAxisOptions)
        return drive_facts(axis)

    def scan(self, ports: Sequence[str], bauds: Sequence[int], report: Report) -> list[FoundDevice]:
        """Devices on ``ports`` (empty: every likely one) at ``bauds`` (empty: all until one answers).

        See `contid.hal.Scans`; a native port has no rate.
        """
        from contid_devices.due.board import scan

        return scan(ports, report)


TOOLS = BoardTools()
