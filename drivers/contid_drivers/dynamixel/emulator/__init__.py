"""Emulated XL330 bus on a pseudo terminal: what the driver is proven against where there is no hardware."""

from contid_drivers.dynamixel.emulator.faults import Fault, FaultSwitches
from contid_drivers.dynamixel.emulator.servo import Servo
from contid_drivers.dynamixel.emulator.wire import Emulator

__all__ = ["Emulator", "Fault", "FaultSwitches", "Servo"]
