"""The contract of a driver: every test, and the states of the bus that they begin from."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager

import pytest

from contid_driverkit.contract.exchange import ExchangeContract
from contid_driverkit.contract.faults import FaultContract
from contid_driverkit.contract.life import LifeContract
from contid_driverkit.contract.rig import BusUnderTest
from contid_driverkit.contract.watchdog import WatchdogContract


class DriverContract(LifeContract, ExchangeContract, WatchdogContract, FaultContract):
    """What the bus of every driver must do; a subclass defines `make`."""

    def make(self) -> AbstractContextManager[BusUnderTest]:
        """A rig whose bus was never opened, with two axes or more at rest."""
        raise NotImplementedError(f"{type(self).__name__} must define make, see contid_driverkit.contract")

    @pytest.fixture
    def rig(self) -> Iterator[BusUnderTest]:
        """A bus that was never opened, closed again whatever the test did."""
        with self.make() as made:
            yield made
            made.bus.close()

    @pytest.fixture
    def ready(self, rig: BusUnderTest) -> BusUnderTest:
        """An open bus with valid samples; nothing enabled."""
        rig.bus.open()
        rig.pump(0.0)
        return rig

    @pytest.fixture
    def enabled(self, ready: BusUnderTest) -> BusUnderTest:
        """An open bus with every axis enabled; nothing commanded yet."""
        ready.bus.enable(ready.bus.axes)
        return ready
