"""Emulated XL330 bus on a pseudo terminal, for tests and use without hardware."""

from contid_emulate.dynamixel.faults import FaultSwitches, InjectedFault
from contid_emulate.dynamixel.servo import Servo
from contid_emulate.dynamixel.tendons import TendonPlant
from contid_emulate.dynamixel.wire import DynamixelEmulator

__all__ = ["DynamixelEmulator", "FaultSwitches", "InjectedFault", "Servo", "TendonPlant"]
