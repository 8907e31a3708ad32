"""`benchmarks.scale` makes files of many robots of every shipped robot that stands alone."""

from __future__ import annotations

import pytest

from benchmarks.scale import many


@pytest.mark.parametrize("name", ["finger", "trirack2", "cbha", "stiffflop2", "tendon3", "trunk"])
def test_copies_are_on_one_simulated_bus(name: str) -> None:
    """Calibrations of regulators stayed in the file, and cbha has two buses."""
    loaded = many(name, 2)
    (bus,) = loaded.buses.values()
    assert bus.driver == "sim"
    assert len(loaded.driven) == 2
    assert len(bus.axes) == 2 * len(next(iter(loaded.driven.values())).all_axis_names)
