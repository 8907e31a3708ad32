"""Every test of this folder runs once per harness."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.contract.harness import HARNESSES, BusUnderTest, harness

# Simulated buses run in virtual time; all others are behind a wire, against real deadlines.
RIGS = [
    pytest.param(name, marks=[] if name.startswith("sim-") else pytest.mark.realtime)
    for name in sorted(HARNESSES)
]


@pytest.fixture(params=RIGS)
def rig(request: pytest.FixtureRequest) -> Iterator[BusUnderTest]:
    """A bus that was never opened, closed again whatever the test did."""
    with harness(request.param) as made:
        yield made
        made.bus.close()


@pytest.fixture
def ready(rig: BusUnderTest) -> BusUnderTest:
    """An open bus with valid samples; nothing enabled."""
    rig.bus.open()
    rig.pump(0.0)
    return rig


@pytest.fixture
def enabled(ready: BusUnderTest) -> BusUnderTest:
    """An open bus with every axis enabled; nothing commanded yet."""
    ready.bus.enable(ready.bus.axes)
    return ready
