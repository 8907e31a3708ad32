"""Dynamixel XL330 servos on a serial bus, Protocol 2.0.

Imported when a robot file names ``driver: dynamixel``; the serial library and the SDK are imported only when
a bus is built.
"""

from contid_drivers.dynamixel.driver import DRIVER

__all__ = ["DRIVER"]
