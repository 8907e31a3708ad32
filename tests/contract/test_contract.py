"""The drivers of contid and of the examples under `contid_driverkit.contract`."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from contid_driverkit.contract import BusUnderTest, DriverContract
from tests.contract.harness import HARNESSES, harness

# Simulated buses run in virtual time; all others are behind a wire, against real deadlines.
RIGS = [
    pytest.param(name, marks=[] if name.startswith("sim-") else pytest.mark.realtime)
    for name in sorted(HARNESSES)
]


@pytest.mark.process
class TestContract(DriverContract):
    @pytest.fixture(params=RIGS)
    def rig(self, request: pytest.FixtureRequest) -> Iterator[BusUnderTest]:
        with harness(request.param) as made:
            yield made
            made.bus.close()


def test_a_subclass_without_a_rig_is_named() -> None:
    with pytest.raises(NotImplementedError, match="TestContract must define make"):
        TestContract().make()
