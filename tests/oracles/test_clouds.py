"""Short form of `tests.oracles.clouds`."""

from __future__ import annotations

import numpy as np
import pytest

from contid.targets import Target, Vec3
from contid.units import BAR
from tests.oracles.bounded import GRAM_N, Case, models
from tests.oracles.clouds import count, straight_to

pytestmark = pytest.mark.campaign

#: An answer is found in bounded work, so a pose of the cloud may be nearer [mm].
FARTHER_MM = 3.0


@pytest.mark.parametrize("grams", [0.0, 5.0, 10.0])
def test_answers_are_as_near_as_a_cloud_of_walked_poses(grams: float) -> None:
    wrong, lost = count(grams, number=24, size=300, seed=3)
    assert lost == 0
    assert not [each for each in wrong if each.case.reachable]
    assert all(each.farther_mm <= FARTHER_MM for each in wrong)


#: Targets [mm] that the arm gets to, or next to, from rest under 5 g, but not straight from a start [bar];
#: how that way ends; how far a pose of a cloud is to which one leads [mm].
FORKED = [
    ((4.218, -19.874, 18.585), (0.699, 0.175, 0.466, 0.531, 0.854, 1.479), "snaps through at", 3.73),
    ((2.0806, 29.5782, 29.0415), (0.4307, 1.372, 1.423, 0.942, 0.4155, 0.0074), "snaps through at", 2.72),
    ((-22.3773, 39.1604, 15.9996), (1.3597, 0.794, 0.1117, 0.4099, 1.3861, 0.8266), "", 2.54),
]


@pytest.mark.parametrize(("tip_mm", "start_bar", "way", "possible_mm"), FORKED)
def test_beside_an_answer_that_is_met_from_rest_only_one_is_found_that_is_met_from_here(
    tip_mm: Vec3, start_bar: tuple[float, ...], way: str, possible_mm: float
) -> None:
    """They were 9.30, 12.31 and 22.68 mm: nothing was searched beside the answer met from rest.

    The third target is met beside it; the notes of the others have how the way to the first answer ends.
    """
    model = models()[0]
    x, y, z = tip_mm
    target = Target((x / 1e3, y / 1e3, z / 1e3), load_n=(0.0, 0.0, 5.0 * GRAM_N))
    assert model.inverse(target, (0.0,) * 6).residual_m < 3e-4
    found = model.inverse(target, tuple(p * BAR for p in start_bar))
    assert found.converged == (way == "")
    assert ("stability" in found.limited_by) == (way != "")
    assert way in found.note
    assert 1e3 * found.residual_m < possible_mm
    case = Case(model, np.array(tip_mm), target.load_n, np.array(start_bar), False)
    tip = 1e3 * np.array(model.forward(found.actuation, target.load_n).tip_m)
    stands, there = straight_to([case], np.array([found.actuation]) / BAR, tip[None])
    assert stands.all()
    assert there.all()
