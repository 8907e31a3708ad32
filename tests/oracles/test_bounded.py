"""Short form of `tests.oracles.bounded`, and targets that a descent from the last command does not reach."""

from __future__ import annotations

import numpy as np
import pytest

from contid import kernels
from contid.kinematics.model import build_model
from contid.robot_file.shipped import load_named
from contid.targets import Target, Vec3
from contid.units import BAR
from tests.oracles.bounded import AS_GOOD_MM, cases, compare

pytestmark = pytest.mark.skipif(kernels.load("cosserat") is None, reason="minutes without compiled kernels")

#: An answer is found in bounded work, so scipy may be nearer; the worst of 280 cases was 8.3 mm [mm].
FARTHER_MM = 12.0


@pytest.mark.parametrize("grams", [0.0, 5.0, 10.0])
def test_answers_are_where_forward_finds_them_and_near_the_best_of_scipy(grams: float) -> None:
    found = [compare(case, starts=3) for case in cases(8, grams)]
    away = [each for each in found if not each.solution.converged]
    assert away
    assert len(away) < len(found)
    assert [each.error_mm for each in found if each.contradicted] == []
    assert all(each.solution.limited_by for each in away)
    for each in away:
        unloaded = each.case.model.setup.weight.is_zero and not grams
        assert each.worse_mm <= (AS_GOOD_MM if unloaded else FARTHER_MM)


@pytest.mark.parametrize("start_bar", [0.0, 0.5, 1.5])
def test_the_bounded_optimum_under_load_does_not_depend_on_the_start(start_bar: float) -> None:
    """35.2 mm are possible; 101.7 mm remained, with nothing in `limited_by`."""
    (robot,) = load_named("stiffflop2").file.robots.values()
    model = build_model(robot)
    tip_m: Vec3 = (0.10365, -0.02817, 0.0367)
    target = Target(tip_m, load_n=(0.0, 0.0, 0.05))
    found = model.inverse(target, (start_bar * BAR,) * 6)
    assert not found.converged
    assert found.limited_by
    assert found.residual_m < 0.036
    reached = model.forward(found.actuation, target.load_n)
    assert reached.stable
    assert np.linalg.norm(np.subtract(reached.tip_m, tip_m)) == pytest.approx(found.residual_m, abs=5e-5)


@pytest.mark.parametrize("tip_mm", [(0.0, 0.0, -30.0), (3.0, 2.0, -10.0), (0.0, 10.0, -40.0)])
def test_an_arm_at_rest_leaves_the_straight_posture(tip_mm: Vec3) -> None:
    """At rest no single pressure brings the tip nearer to a target behind it, which bent sections reach."""
    (robot,) = load_named("stiffflop2").file.robots.values()
    model = build_model(robot)
    x, y, z = tip_mm
    tip_m = (x / 1e3, y / 1e3, z / 1e3)
    target = Target(tip_m)
    found = model.inverse(target, (0.0,) * 6)
    assert found.converged
    assert np.linalg.norm(np.subtract(model.forward(found.actuation).tip_m, tip_m)) < 1e-8
