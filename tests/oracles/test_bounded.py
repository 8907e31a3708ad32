"""Short form of `tests.oracles.bounded`, and targets that a descent from the last command does not reach."""

from __future__ import annotations

import numpy as np
import pytest

from contid.kinematics.cosserat.model import CosseratModel
from contid.kinematics.extra_axes import build_whole_model
from contid.kinematics.model import build_model
from contid.robot_file.load import load_named
from contid.targets import Target, Vec3
from contid.units import BAR, MM_PER_M
from tests.oracles.bounded import AS_GOOD_MM, GRAM_N, answer, cases, compare, models

pytestmark = pytest.mark.campaign

#: An answer is found in bounded work, so scipy may be nearer [mm].
FARTHER_MM = 3.0
#: The estimated discretisation error: answers that differ by less are as near [mm].
SETTLED_MM = 0.03


@pytest.mark.parametrize("grams", [0.0, 5.0, 10.0])
def test_answers_are_where_forward_finds_them_and_near_the_best_of_scipy(grams: float) -> None:
    found = [compare(case, starts=3) for case in cases(8, grams)]
    away = [each for each in found if not each.solution.converged]
    assert away
    assert len(away) < len(found)
    assert [each.error_mm for each in found if each.contradicted] == []
    assert [each.error_mm for each in found if not each.walked_there()] == []
    assert all(each.solution.limited_by for each in away)
    for each in away:
        unloaded = not each.case.model.setup.weight.weight and not grams
        assert each.worse_mm <= (AS_GOOD_MM if unloaded else FARTHER_MM)


@pytest.mark.parametrize(
    ("seed", "grams", "index", "ticks"),
    [(33, 10.0, 24, False), (47, 10.0, 1, False), (58, 10.0, 14, False), (21, 10.0, 41, True)],
)
def test_a_target_asked_again_has_no_farther_answer(seed: int, grams: float, index: int, ticks: bool) -> None:
    """0.4 to 20 mm more remained: few elements have no pose where the arm stands, or a search missed it."""
    case = cases(index + 1, grams, seed, ticks)[index]
    first = answer(case, tuple((case.seed * BAR).tolist()))
    again = answer(case, first.actuation)
    assert not first.converged
    assert first.limited_by
    assert again.residual_m <= first.residual_m + AS_GOOD_MM / MM_PER_M


@pytest.mark.parametrize(("seed", "grams", "index"), [(16, 5.0, 9), (16, 5.0, 46), (21, 5.0, 24)])
def test_a_thorough_answer_out_of_reach_is_settled(seed: int, grams: float, index: int) -> None:
    """Asked again from its own answer it was 0.3 to 3 mm nearer."""
    case = cases(index + 1, grams, seed)[index]
    first = answer(case, tuple((case.seed * BAR).tolist()))
    again = answer(case, first.actuation)
    assert not first.converged
    assert again.residual_m >= first.residual_m - SETTLED_MM / MM_PER_M


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


#: Targets [mm], loads [g], starts [bar], and errors that are possible [mm]; 2 to 8 mm more remained.
ALONG_THE_END = [
    (
        (-18.558405, 49.395867, -22.412243),
        5,
        (0.894452, 1.385607, 0.399649, 1.483043, 1.373035, 1.00662),
        35.05,
    ),
    (
        (91.747375, -58.877917, -15.112598),
        5,
        (1.068106, 0.706916, 1.0572, 1.250742, 0.435806, 0.699447),
        61.62,
    ),
    ((-2.40303, -88.731585, 5.470212), 5, (1.027569, 0.271085, 0.759788, 0.1596, 0.313037, 0.684344), 33.0),
    ((-38.590735, -82.844662, 7.501999), 5, (0.75, 0.75, 0.75, 0.75, 0.75, 0.75), 35.9),
    ((37.466308, -45.208413, 15.069833), 5, (0.75, 0.75, 0.75, 0.75, 0.75, 0.75), 18.1),
    ((-18.203186, -23.567243, -16.655114), 5, (0.75, 0.75, 0.75, 0.75, 0.75, 0.75), 27.0),
    (
        (41.850014, -5.606143, 18.900178),
        10,
        (1.011488, 1.380287, 1.374898, 0.249387, 0.89336, 0.937326),
        43.65,
    ),
]


@pytest.mark.parametrize(("tip_mm", "grams", "start_bar", "possible_mm"), ALONG_THE_END)
def test_an_answer_slides_along_the_end_of_the_branch(
    tip_mm: Vec3, grams: int, start_bar: tuple[float, ...], possible_mm: float
) -> None:
    (robot,) = load_named("stiffflop2").file.robots.values()
    model = build_model(robot)
    x, y, z = tip_mm
    target = Target((x / 1e3, y / 1e3, z / 1e3), load_n=(0.0, 0.0, grams * GRAM_N))
    found = model.inverse(target, tuple(p * BAR for p in start_bar))
    assert not found.converged
    assert found.limited_by
    assert 1e3 * found.residual_m < possible_mm + 0.1
    reached = model.forward(found.actuation, target.load_n)
    assert reached.stable
    assert np.linalg.norm(np.subtract(reached.tip_m, target.tip_m or ())) == pytest.approx(
        found.residual_m, abs=5e-5
    )


#: Arms (as shipped; heavy, tilted), targets [mm], loads [g], starts [bar]; errors of poses of a cloud [mm].
AT_CORNERS = [
    (1, (7.496608, 3.304488, 46.557806), 5, (0.4437, 0.9268, 0.0484, 1.3612, 0.8272, 1.025), 23.79),
    (1, (-5.494566, 19.586092, 21.965882), 5, (0.5607, 0.8983, 0.9209, 0.0636, 0.8397, 0.1983), 52.38),
    (0, (4.551746, -44.759542, 1.058774), 5, (0.3076, 0.668, 0.922, 1.4951, 0.691, 0.6927), 24.58),
    (0, (-74.444654, 44.070045, -15.080139), 10, (0.561, 0.4879, 1.1955, 0.8621, 0.5341, 0.2455), 92.11),
]


@pytest.mark.parametrize(("arm", "tip_mm", "grams", "start_bar", "possible_mm"), AT_CORNERS)
def test_a_pose_at_a_corner_is_found_where_the_arm_swings_far_next_to_it(
    arm: int, tip_mm: Vec3, grams: int, start_bar: tuple[float, ...], possible_mm: float
) -> None:
    """1.5 to 12 mm more remained: starts 0.05 bar inside the corner are on the other side of a fork."""
    x, y, z = tip_mm
    target = Target((x / 1e3, y / 1e3, z / 1e3), load_n=(0.0, 0.0, grams * GRAM_N))
    found = models()[arm].inverse(target, tuple(p * BAR for p in start_bar))
    assert not found.converged
    assert found.limited_by
    assert 1e3 * found.residual_m < possible_mm + 0.1


def test_a_way_that_ends_at_another_equilibrium_without_a_snap_is_in_the_note() -> None:
    model = models()[1]
    target = Target((-25.89e-3, -57.11e-3, 111.91e-3), load_n=(0.0, 0.0, 5.0 * GRAM_N))
    assert model.inverse(target, (0.0,) * 6).converged
    found = model.inverse(target, tuple(p * BAR for p in (0.657, 0.678, 0.096, 0.117, 1.009, 0.079)))
    assert not found.converged
    assert "stability" in found.limited_by
    assert "is elsewhere after" in found.note


def test_in_the_control_loop_a_search_is_short_and_its_answer_is_on_the_branch() -> None:
    """Its work is a part of that of a search elsewhere; what it answers is where the arm is all the same."""
    (robot,) = load_named("stiffflop2").file.robots.values()
    full, short = build_model(robot), build_whole_model(robot)
    assert isinstance(short, CosseratModel)
    for (x, y, z), grams, start_bar, _ in ALONG_THE_END:
        target = Target((x / 1e3, y / 1e3, z / 1e3), load_n=(0.0, 0.0, grams * GRAM_N))
        seed = tuple(p * BAR for p in start_bar)
        thorough, brief = full.inverse(target, seed), short.inverse(target, seed)
        assert not brief.converged
        assert brief.limited_by
        assert brief.iterations < min(1000, 0.4 * thorough.iterations)
        assert brief.residual_m > thorough.residual_m - 1e-5
        reached = short.forward(brief.actuation, target.load_n)
        assert reached.stable
        assert np.linalg.norm(np.subtract(reached.tip_m, target.tip_m or ())) == pytest.approx(
            brief.residual_m, abs=5e-5
        )


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
