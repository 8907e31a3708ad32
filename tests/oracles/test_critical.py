"""Short form of `tests.oracles.critical`."""

from __future__ import annotations

import pytest

from tests.oracles.critical import count

pytestmark = pytest.mark.campaign


@pytest.mark.parametrize("name", ["stiffflop1", "stiffflop2"])
def test_critical_loads_and_verdicts_are_those_of_the_walk(name: str) -> None:
    assert count(name, cases=50, seed=3)
