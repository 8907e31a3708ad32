"""Dynamixel XL330 servos on a serial bus, Protocol 2.0."""

from contid_drivers.dynamixel.driver import DRIVER

__all__ = ["DRIVER"]
