"""Arduino Due boards: geared motors with encoders, and proportional pressure regulators.

Imported when a robot file names ``driver: due``; the serial library is imported only when a bus is built.
"""

from contid_drivers.due.driver import DRIVER

__all__ = ["DRIVER"]
