"""Emulated XL330 bus on a pseudo terminal, for tests and use without hardware."""

from contid_drivers.dynamixel.emulator.faults import FaultSwitches, InjectedFault
from contid_drivers.dynamixel.emulator.servo import Servo
from contid_drivers.dynamixel.emulator.tendons import TendonPlant
from contid_drivers.dynamixel.emulator.wire import DynamixelEmulator

__all__ = ["DynamixelEmulator", "FaultSwitches", "InjectedFault", "Servo", "TendonPlant"]
