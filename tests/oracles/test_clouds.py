"""Short form of `tests.oracles.clouds`."""

from __future__ import annotations

import pytest

from contid import kernels
from tests.oracles.clouds import AS_NEAR_MM, count

#: An answer is found in bounded work, so a pose of the cloud may be nearer [mm].
FARTHER_MM = 3.0


@pytest.mark.skipif(kernels.load("cosserat") is None, reason="minutes without compiled kernels")
@pytest.mark.parametrize("grams", [0.0, 5.0, 10.0])
def test_answers_are_as_near_as_a_cloud_of_walked_poses(grams: float) -> None:
    found, lost = count(grams, number=24, size=300, seed=3)
    drawn = [each.left_mm for each in found if each.case.reachable]
    assert len(drawn) > 20
    assert max(drawn) <= AS_NEAR_MM
    assert lost == 0
    assert max(each.farther_mm for each in found) <= FARTHER_MM
