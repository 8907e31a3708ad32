"""Arduino Due boards: geared motors with encoders, and proportional pressure regulators."""

from contid_drivers.due.driver import DRIVER

__all__ = ["DRIVER"]
