"""Contract of every model: limits, true residual, continuity, no exceptions."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import yaml

from contid.kinematics.model import Model, build_model
from contid.robot_file.document import RobotFile
from contid.targets import Target, vec3

#: Every shipped robot, and the solvers no shipped file selects.
ROBOTS = ("finger", "trirack", "trirack2", "cbha", "cbha.ph", "stiffflop1", "stiffflop2", "tendon3")
#: What a solver may leave at best [m], and with a direction beside the tip.
WITHIN_M = {"cbha.ph": (5e-4, 0.03)}
#: How much farther than the answer to a far target a random posture may get in its direction [m].
FAR_M = 1e-6


@pytest.fixture(scope="module", params=ROBOTS)
def named(request: pytest.FixtureRequest) -> tuple[str, Model]:
    name, _, solver = request.param.partition(".")
    raw = yaml.safe_load((Path(__file__).parents[2] / "configs" / f"{name}.yaml").read_text())
    robot = next(iter(raw["robots"].values()))
    if solver:
        robot["solver"] = {"method": solver}
    described = next(iter(RobotFile.model_validate(raw).robots.values()))
    return request.param, build_model(described)


def middle(model: Model) -> tuple[float, ...]:
    return tuple(0.5 * (low + high) for low, high in zip(model.lower, model.upper, strict=True))


def postures(model: Model, count: int) -> list[tuple[float, ...]]:
    """Postures well inside the limits, seeded; a model whose limits couple its axes moves them inside."""
    rng = np.random.default_rng(5)
    low, high = np.array(model.lower), np.array(model.upper)
    share = rng.uniform(0.35, 0.65, (count, len(low)))
    rows = [tuple(row) for row in (low + share * (high - low)).tolist()]
    return [model.inverse(Target(actuation=row), row).actuation for row in rows]


def inside(model: Model, actuation: tuple[float, ...]) -> bool:
    slack = 1e-9 * max(map(abs, model.upper))
    return all(
        low - slack <= value <= high + slack
        for low, value, high in zip(model.lower, actuation, model.upper, strict=True)
    )


def test_a_reachable_tip_is_found_with_its_true_residual(named: tuple[str, Model]) -> None:
    name, model = named
    within_m, _ = WITHIN_M.get(name, (2e-6, 0.0))
    for posture in postures(model, 6):
        # A tip that a posture near the middle takes; one arc reaches it too, where there is one.
        tip = model.forward(posture).tip_m
        solution = model.inverse(Target(tip_m=tip), middle(model))
        assert solution.converged, solution
        assert inside(model, solution.actuation)
        missed_m = math.dist(model.forward(solution.actuation).tip_m, tip)
        assert missed_m == pytest.approx(solution.residual_m, abs=1e-7)
        assert missed_m <= within_m


@pytest.mark.parametrize(
    "tip",
    [(0.0, 0.0, 0.0), (0.0, 0.0, -0.1), (3.0, 0.0, 3.0), (1e150, 0.0, 1e150), (math.nan, 0.0, 0.2)],
    ids=["base", "behind", "far", "absurd", "nan"],
)
def test_no_target_raises_or_leads_outside_the_limits(
    named: tuple[str, Model], tip: tuple[float, float, float]
) -> None:
    _, model = named
    if model.dimension == 2:
        tip = (tip[0], tip[2], 0.0)
    solution = model.inverse(Target(tip_m=tip), middle(model))
    assert np.isfinite(solution.actuation).all()
    assert inside(model, solution.actuation)
    if tip[0] != 0.0:
        assert not solution.converged


@pytest.mark.parametrize(
    "away_m",
    [1e3, *(pytest.param(away_m, marks=pytest.mark.campaign) for away_m in (1e7, 1e30, 1e200)), 1e307],
)
def test_the_answer_to_a_far_target_is_the_posture_farthest_in_its_direction(
    named: tuple[str, Model], away_m: float
) -> None:
    name, model = named
    rng = np.random.default_rng(9)
    low, high = np.array(model.lower), np.array(model.upper)
    shares = np.clip(rng.uniform(-0.5, 1.5, (400, len(low))), 0.0, 1.0)
    rows = [tuple(row) for row in (low + shares * (high - low)).tolist()]
    sampled = [model.forward(model.inverse(Target(actuation=row), middle(model)).actuation) for row in rows]
    tips = np.array([pose.tip_m for pose in sampled if pose.stable])
    for towards in rng.normal(size=(4, 3)):
        if model.dimension == 2:
            towards[2] = 0.0
        towards /= np.linalg.norm(towards)
        x, y, z = (away_m * towards).tolist()
        solution = model.inverse(Target(tip_m=(x, y, z)), middle(model))
        assert not solution.converged
        assert solution.limited_by
        assert inside(model, solution.actuation)
        assert solution.residual_m == pytest.approx(away_m, rel=2e-3)
        if name == "cbha.ph":
            continue  # it follows one curve and promises no nearest answer
        reached = np.array(model.forward(solution.actuation).tip_m)
        assert reached @ towards >= (tips @ towards).max() - FAR_M


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
def test_a_tip_that_is_not_finite_leaves_the_robot_inside_its_limits(
    named: tuple[str, Model], wrong: float
) -> None:
    _, model = named
    for number in range(model.dimension):
        tip = [0.1, 0.1, 0.1][: model.dimension] + [0.0] * (3 - model.dimension)
        tip[number] = wrong
        solution = model.inverse(Target(tip_m=vec3(tip)), middle(model))
        assert not solution.converged
        assert solution.limited_by
        assert inside(model, solution.actuation)


def test_an_actuation_is_kept_or_clamped(named: tuple[str, Model]) -> None:
    _, model = named
    for posture in postures(model, 3):
        kept = model.inverse(Target(actuation=posture), middle(model))
        assert kept.converged
        assert kept.actuation == pytest.approx(posture)
    clamped = model.inverse(
        Target(actuation=tuple(2.0 * value + 1.0 for value in model.upper)), middle(model)
    )
    assert not clamped.converged
    assert clamped.limited_by
    assert inside(model, clamped.actuation)


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
def test_an_actuation_that_is_not_finite_leaves_the_robot_where_it_is(
    named: tuple[str, Model], wrong: float
) -> None:
    _, model = named
    seed = middle(model)
    for number in range(len(seed)):
        requested = (*seed[:number], wrong, *seed[number + 1 :])
        held = model.inverse(Target(actuation=requested), seed)
        assert (held.actuation, held.converged) == (seed, False)
        assert "not finite" in held.note


def test_small_steps_of_the_tip_are_small_steps_of_the_answer(named: tuple[str, Model]) -> None:
    """Seeded with the answer before, as the tick does; no step is more than a few times the median one."""
    _, model = named
    start, end = (np.array(model.forward(posture).tip_m) for posture in postures(model, 2))
    seed = model.inverse(Target(tip_m=tuple(start.tolist())), middle(model)).actuation
    steps = []
    for share in np.linspace(0.0, 1.0, 41)[1:]:
        tip = start + share * (end - start)
        solution = model.inverse(Target(tip_m=tuple(tip.tolist())), seed)
        steps.append(max(abs(a - b) for a, b in zip(solution.actuation, seed, strict=True)))
        seed = solution.actuation
    assert max(steps) <= 5.0 * float(np.median(steps)) + 1e-12


def test_the_jacobian_is_the_derivative_of_the_tip(named: tuple[str, Model]) -> None:
    _, model = named
    (posture,) = postures(model, 1)
    jacobian = model.jacobian(posture)
    for axis, span in enumerate(np.array(model.upper) - np.array(model.lower)):
        step = 1e-4 * span
        more, less = (
            np.array(model.forward((*posture[:axis], posture[axis] + h, *posture[axis + 1 :])).tip_m)
            for h in (step, -step)
        )
        scale = np.abs(jacobian).max()
        np.testing.assert_allclose(jacobian[:, axis], (more - less) / (2.0 * step), atol=1e-4 * scale)


def test_the_shape_ends_at_base_and_tip(named: tuple[str, Model]) -> None:
    _, model = named
    (posture,) = postures(model, 1)
    points = model.shape(posture, 9)
    np.testing.assert_allclose(points[0], 0.0, atol=1e-12)
    np.testing.assert_allclose(points[-1], model.forward(posture).tip_m, atol=1e-6)


def test_a_target_direction_is_part_of_the_residual(named: tuple[str, Model]) -> None:
    name, model = named
    if not name.startswith("cbha"):
        pytest.skip("only the solvers of the CBHA are compared here")
    _, within_m = WITHIN_M.get(name, (0.0, 2e-6))
    for posture in postures(model, 6):
        pose = model.forward(posture)
        solution = model.inverse(Target(tip_m=pose.tip_m, direction=pose.direction), middle(model))
        reached = model.forward(solution.actuation)
        off = math.hypot(
            math.dist(reached.tip_m, pose.tip_m), 0.048 * math.dist(reached.direction, pose.direction)
        )
        assert off == pytest.approx(solution.residual_m, abs=1e-7)
        assert solution.residual_m <= max(within_m, 2e-6)
        assert solution.converged == (solution.residual_m <= (5e-3 if name == "cbha.ph" else 1e-6))


def test_a_seed_that_is_no_number_gets_an_answer_inside_the_limits(named: tuple[str, Model]) -> None:
    _, model = named
    tip = model.forward(postures(model, 1)[0]).tip_m
    solution = model.inverse(Target(tip_m=tip), (math.nan,) * len(model.axis_names))
    assert inside(model, solution.actuation)
    assert solution.converged
