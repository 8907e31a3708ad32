"""Short form of `tests.oracles.clouds`."""

from __future__ import annotations

import pytest

from contid import kernels
from tests.oracles.clouds import count

#: An answer is found in bounded work, so a pose of the cloud may be nearer [mm].
FARTHER_MM = 3.0


@pytest.mark.skipif(kernels.load("cosserat") is None, reason="minutes without compiled kernels")
@pytest.mark.parametrize("grams", [0.0, 5.0, 10.0])
def test_answers_are_as_near_as_a_cloud_of_walked_poses(grams: float) -> None:
    wrong, lost = count(grams, number=24, size=300, seed=3)
    assert lost == 0
    assert not [each for each in wrong if each.case.reachable]
    assert all(each.farther_mm <= FARTHER_MM for each in wrong)
