"""Short forms of `tests.oracles.runs` (from wherever the devices stand when armed) and `warm_rods`."""

from __future__ import annotations

import pytest

from tests.oracles.runs import ROBOTS, random_run
from tests.oracles.warm_rods import count

pytestmark = pytest.mark.campaign

CASES = 3


@pytest.mark.parametrize("name", ROBOTS)
def test_no_run_ends_without_a_fault_and_with_a_wrong_tip(name: str) -> None:
    found = [random_run(name, seed) for seed in range(CASES)]
    assert [each for each in found if each.kind == "wrong"] == []
    assert any(each.kind == "followed" for each in found)


def test_an_arm_is_not_lost_to_another_equilibrium() -> None:
    """Where a point of a path may be far from its prediction, this run ends 114 mm from its targets."""
    assert random_run("stiffflop2", 1789).kind == "followed"


def test_warm_answers_of_a_loaded_arm_are_where_forward_is() -> None:
    assert count(4000, seed=3)
