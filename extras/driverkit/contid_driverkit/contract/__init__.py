"""The contract tests of buses, for the driver of anyone; needs pytest.

A driver's own tests subclass `DriverContract` and provide a rig, which is its bus with its emulator, or with
the device on a bench::

    class TestMyBus(DriverContract):
        def make(self):  # a context manager of a BusUnderTest
            return my_rig()

Every rule of `contid.hal` is a test then. ``Facts.watchdog_s=None`` declares devices without a watchdog: what
depends on one is skipped, and that there is none is tested.
"""

import pytest

pytest.register_assert_rewrite(*(f"{__name__}.{name}" for name in ("exchange", "faults", "life", "watchdog")))

from contid_driverkit.contract.driver_contract import DriverContract  # noqa: E402
from contid_driverkit.contract.rig import TICK_S, BusUnderTest, Facts, RealTimeRig, offset, values  # noqa: E402

__all__ = [
    "TICK_S",
    "BusUnderTest",
    "DriverContract",
    "Facts",
    "RealTimeRig",
    "offset",
    "values",
]
