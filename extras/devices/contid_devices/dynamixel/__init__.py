"""What is done with Dynamixel servos beside a run; modules that touch a port are imported on use."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING

from contid.hal import AxisOnBus, Finding, FoundDevice, Homed, RegisterValue, Report
from contid_devices.pulsed_motors import DriveFacts, PulsedBus
from contid_drivers.dynamixel.options import DynamixelAxisOptions, DynamixelBusOptions

if TYPE_CHECKING:
    from pydantic import BaseModel


class DynamixelTools:
    """Search, diagnosis, homing, pulses and commissioning of servos (entry point ``contid.tools``)."""

    def doctor(self, name: str, options: BaseModel, axes: Sequence[AxisOnBus]) -> list[Finding]:
        """Examine without motion; problems are findings, not exceptions (`contid.hal.Diagnoses`)."""
        from contid_devices.dynamixel.doctor import examine

        assert isinstance(options, DynamixelBusOptions)
        return examine(name, options, axes)

    def accept(self, name: str, options: BaseModel, axes: Sequence[AxisOnBus], report: Report) -> None:
        """Take the devices that answer as those of the bus (`contid.hal.Identifies`)."""
        from contid_devices.dynamixel.setup import accept

        assert isinstance(options, DynamixelBusOptions)
        accept(name, options, axes, report)

    def home(
        self, name: str, options: BaseModel, axes: Sequence[AxisOnBus], only: Sequence[str], report: Report
    ) -> list[Homed]:
        """Move axes to their reference one after the other; they rest afterwards (`contid.hal.Homes`)."""
        from contid_devices.dynamixel.homing import home

        assert isinstance(options, DynamixelBusOptions)
        return home(name, options, axes, only, report)

    def pulsed_bus(
        self, name: str, options: BaseModel, axes: Sequence[AxisOnBus]
    ) -> AbstractContextManager[PulsedBus]:
        """Open the bus for pulses; on exit every servo is without torque (see `Pulses`)."""
        from contid_devices.dynamixel.pulses import pulsed_bus

        assert isinstance(options, DynamixelBusOptions)
        return pulsed_bus(name, options, axes)

    def drive_facts(self, axis: BaseModel) -> DriveFacts:
        """What the manual states about the motor of a servo."""
        from contid_devices.dynamixel.pulses import drive_facts

        assert isinstance(axis, DynamixelAxisOptions)
        return drive_facts(axis)

    def scan(self, ports: Sequence[str], bauds: Sequence[int], report: Report) -> list[FoundDevice]:
        """Devices on ``ports`` (empty: every likely one) at ``bauds`` (empty: all until one answers)."""
        from contid_devices.dynamixel.scan import scan

        return scan(ports, bauds, report)

    def set_id(self, port: str, baud: int, device: int, new: int) -> None:
        """Change the id of the device with id ``device`` to ``new`` (`contid.hal.Commissions`)."""
        from contid_devices.dynamixel import commission

        commission.set_id(port, baud, device, new)

    def set_baud(self, port: str, baud: int, device: int, new: int) -> None:
        """Change the baud rate of the device with id ``device`` to ``new`` (`contid.hal.Commissions`)."""
        from contid_devices.dynamixel import commission

        commission.set_baud(port, baud, device, new)

    def reboot(self, port: str, baud: int, device: int) -> None:
        """Restart a device; its torque is off afterwards (`contid.hal.Commissions`)."""
        from contid_devices.dynamixel import commission

        commission.reboot(port, baud, device)

    def blink(self, port: str, baud: int, device: int, times: int) -> None:
        """Let the LED of a device blink (`contid.hal.Commissions`)."""
        from contid_devices.dynamixel import bench_tools

        bench_tools.blink(port, baud, device, times)

    def read_registers(self, port: str, baud: int, device: int, names: Sequence[str]) -> list[RegisterValue]:
        """Registers of a device by name; the usual ones without ``names`` (`contid.hal.Commissions`)."""
        from contid_devices.dynamixel import bench_tools

        return bench_tools.read(port, baud, device, names)

    def write_register(self, port: str, baud: int, device: int, name: str, value: int) -> int:
        """Set a register that moves nothing; returns what it holds afterwards (`contid.hal.Commissions`)."""
        from contid_devices.dynamixel import bench_tools

        return bench_tools.write(port, baud, device, name, value)

    def factory_reset(self, port: str, baud: int, device: int) -> None:
        """Restore the factory value of every setting but id and baud rate (`contid.hal.Commissions`)."""
        from contid_devices.dynamixel import bench_tools

        bench_tools.reset(port, baud, device)

    def setup(
        self,
        name: str,
        options: BaseModel,
        axes: Sequence[AxisOnBus],
        ask: Callable[[str], None],
        report: Report,
    ) -> None:
        """Give the devices of a bus the ids of the robot file, one device after the other."""
        from contid_devices.dynamixel.setup import setup

        assert isinstance(options, DynamixelBusOptions)
        setup(name, options, axes, ask, report)


TOOLS = DynamixelTools()
