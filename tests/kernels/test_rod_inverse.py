"""The inverse of the rod's kernel: tasks met, optima by Karush, Kuhn and Tucker, limits, symmetry, order."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import least_squares, lsq_linear

from contid.kinematics.array import Array
from contid.kinematics.cosserat.engine import NO_SNAP, InverseAnswer, Limits, RodSolver
from contid.targets import ZERO3, Vec3
from tests.kernels.rod_tasks import Task, own_weight, pull_inside, rod_of
from tests.kinematics.cosserat_cases import GRAM, one, solver, two

TOLERANCE = 1e-6
#: Uneven limits and centres [bar].
LOW, HIGH, CENTRE = 0.12, 1.04, 0.41


def uneven(sections: int) -> Limits:
    step: Array = 0.03 * np.arange(3 * sections, dtype=np.float64)
    return Limits(LOW + 0.3 * step, HIGH + step, CENTRE + step)


def assert_met(engine: RodSolver, task: Task, found: InverseAnswer) -> None:
    assert found.met
    assert found.optimal
    assert found.stable
    assert not found.blocked
    assert found.snap == NO_SNAP
    assert found.residual_mm <= engine.setup.tolerance
    assert found.balance_nmm <= 1e-6
    assert_inside(engine, found)
    assert np.linalg.norm(task.error(engine, np.array(found.pressures_bar))) <= 3.0 * TOLERANCE


def assert_inside(engine: RodSolver, found: InverseAnswer) -> None:
    limits = engine.setup.limits
    assert np.all(np.array(found.pressures_bar) >= limits.lower)
    assert np.all(np.array(found.pressures_bar) <= limits.upper)


@pytest.mark.parametrize("weighs", [False, True])
@pytest.mark.parametrize("force", [ZERO3, (0.004, -0.006, 0.03)])
@pytest.mark.parametrize(
    ("sections", "kind"), [(1, "tip"), (2, "mid"), (2, "tip"), (2, "direction"), (3, "tip")]
)
def test_poses_of_other_pressures_are_met(sections: int, kind: str, force: Vec3, weighs: bool) -> None:
    """From next to the answer and from afar; where the task has no freedom, the pressures are those."""
    engine = solver(rod_of(sections), own_weight(sections) if weighs else None, limits=uneven(sections))
    limits, rng = engine.setup.limits, np.random.default_rng([sections, weighs, len(kind)])
    unique = 3 * sections == (6 if kind == "mid" else 3)
    for _ in range(6):
        bar = rng.uniform(limits.lower, limits.upper)
        task = Task.reached(engine, bar, kind, force)
        if task is None:
            continue
        near, far = (
            np.clip(bar + rng.uniform(-0.02, 0.02, len(bar)), limits.lower, limits.upper),
            limits.centre,
        )
        for seed in (near, far):
            found = task.solve(engine, seed)
            if found.snap < NO_SNAP and seed is far:
                continue  # the straight way there snaps
            assert_met(engine, task, found)
            assert found.elements == 3
            if unique:
                assert np.abs(np.array(found.pressures_bar) - bar).max() < 2e-5
        assert task.solve(engine, near) == task.solve(engine, near)


@pytest.mark.parametrize("weighs", [False, True])
@pytest.mark.parametrize("sections", [1, 2])
def test_from_one_command_to_the_next_few_sweeps_are_needed(sections: int, weighs: bool) -> None:
    """Newton's method with chords: one sweep with derivatives a tick, three for two heavy sections."""
    engine = solver(rod_of(sections), own_weight(sections) if weighs else None, tolerance=1e-4)
    force, kind = (0.0, 0.0, 5.0 * GRAM), "tip" if sections == 1 else "mid"
    begin, end = np.random.default_rng(5).uniform(0.2, 1.2, (2, 3 * sections))
    seed, spent = begin, []
    for part in np.linspace(0.0, 0.3, 100)[1:]:
        bar = begin + part * (end - begin)
        task = Task.reached(engine, bar, kind, force)
        assert task is not None
        found = task.solve(engine, seed)
        assert found.met
        seed = np.array(found.pressures_bar)
        assert np.abs(seed - bar).max() < 1e-4
        spent.append(found.iterations)
    assert max(spent) <= (3 if weighs and sections == 2 else 1)
    assert min(spent) >= 1


@pytest.mark.parametrize("grams", [0.0, 3.0])
@pytest.mark.parametrize(("sections", "kind", "weighs", "sweeps"), [
    (2, "tip", False, 4.0), (2, "tip", True, 8.2), (2, "direction", False, 7.0), (2, "direction", True, 7.2),
    (3, "tip", False, 6.0), (3, "tip", True, 42.0),
])  # fmt: skip
def test_a_redundant_path_is_followed_in_few_sweeps_to_the_settled_answers(
    sections: int, kind: str, weighs: bool, sweeps: float, grams: float
) -> None:
    """Answers along it are those of the same targets from elsewhere, to what counts as settled."""
    engine = solver(rod_of(sections), own_weight(sections) if weighs else None, limits=uneven(sections))
    limits, force = engine.setup.limits, (0.0, 0.0, grams * GRAM)
    begin, end = np.random.default_rng(3).uniform(limits.lower, limits.upper, (2, 3 * sections))
    seed, spent = limits.centre, []
    for k, part in enumerate(np.linspace(0.0, 0.1, 24)):
        task = Task.reached(engine, begin + part * (end - begin), kind, force)
        assert task is not None
        found = task.solve(engine, seed)
        assert_met(engine, task, found)
        moved = np.array(found.pressures_bar) - seed
        seed = np.array(found.pressures_bar)
        if k > 1:
            spent.append(found.iterations)
            assert np.abs(moved).max() < 0.03
        if k % 6 == 5:
            aside = np.clip(seed + 0.04 * np.cos(np.arange(len(seed))), limits.lower, limits.upper)
            assert np.abs(np.array(task.solve(engine, aside).pressures_bar) - seed).max() < 1e-6
            again = task.solve(engine, seed)
            assert np.abs(np.array(again.pressures_bar) - seed).max() < 1e-6
    assert np.mean(spent) <= sweeps


@pytest.mark.parametrize(("sections", "kind", "force", "weighs"), [
    (2, "tip", ZERO3, False),
    (2, "direction", ZERO3, False),
    (2, "tip", (0.004, -0.006, 0.03), False),
    (2, "direction", (0.004, -0.006, 0.03), True),
    (3, "tip", ZERO3, False),
    (3, "direction", (0.0, 0.001, 0.005), False),
])  # fmt: skip
def test_redundancy_is_resolved_nearest_to_the_centre(
    sections: int, kind: str, force: Vec3, weighs: bool
) -> None:
    """P - c is a combination of the task's gradients, but for limits, which hold back what would leave them.

    Asked again, and from a neighbour, the answer stays. No pressures near it with the same pose are nearer.
    """
    engine = solver(rod_of(sections), own_weight(sections) if weighs else None, limits=uneven(sections))
    limits, rng, at_limits = engine.setup.limits, np.random.default_rng([9, sections, len(kind)]), 0
    for _ in range(6):
        # Often at limits, so that these hold the answers back.
        drawn = np.clip(rng.uniform(limits.lower - 0.4, limits.upper + 0.4), limits.lower, limits.upper)
        task = Task.reached(engine, drawn, kind, force)
        if task is None:
            continue
        found = task.solve(engine, limits.centre)
        if not found.met:
            assert found.snap < NO_SNAP
            continue
        bar = np.array(found.pressures_bar)
        J, away = task.jacobian(engine, bar), bar - limits.centre
        free = (bar > limits.lower) & (bar < limits.upper)
        at_limits += int((~free).sum())
        assert _unbalanced(engine, bar, away, J) < 6e-5
        again = task.solve(engine, bar)
        assert np.abs(np.array(again.pressures_bar) - bar).max() < 2e-7
        beside = np.clip(bar + rng.uniform(-0.03, 0.03, len(bar)), limits.lower, limits.upper)
        assert np.abs(np.array(task.solve(engine, beside).pressures_bar) - bar).max() < 1e-6
        _, _, across = np.linalg.svd(J[:, free])
        freedom = across[np.linalg.matrix_rank(J[:, free], 1e-3) :]
        for direction in freedom[:2]:
            for size in (0.02, -0.02):
                moved = bar.copy()
                moved[free] += size * direction
                moved = _back_onto(engine, task, np.clip(moved, limits.lower, limits.upper), J)
                if np.linalg.norm(task.error(engine, moved)) < 1e-5:
                    assert np.linalg.norm(moved - limits.centre) >= np.linalg.norm(away) - 1e-6
    assert at_limits >= 3


def _unbalanced(engine: RodSolver, bar: Array, away: Array, J: Array) -> float:
    """What is left of ``away + J' y + multipliers of limits``, these of the right sign, at best."""
    limits, n = engine.setup.limits, len(bar)
    low, high = np.flatnonzero(bar <= limits.lower), np.flatnonzero(bar >= limits.upper)
    columns = np.hstack([J.T, -np.eye(n)[:, low], np.eye(n)[:, high]])
    least = np.concatenate([np.full(len(J), -np.inf), np.zeros(len(low) + len(high))])
    return float(np.abs(lsq_linear(columns, -away, (least, np.inf), tol=1e-14).fun).max())


def _back_onto(engine: RodSolver, task: Task, bar: Array, J: Array) -> Array:
    """Pressures inside the limits with the pose of a task, by steps of least length from others."""
    inverse = np.linalg.pinv(J, 1e-6)
    for _ in range(12):
        bar = np.clip(
            bar - inverse @ task.error(engine, bar), engine.setup.limits.lower, engine.setup.limits.upper
        )
    return bar


@pytest.mark.parametrize(("sections", "kind", "full"), [
    (1, "tip", False), (2, "tip", False), (2, "mid", False), (2, "direction", False), (2, "direction", True),
    (3, "direction", False),
])  # fmt: skip
@pytest.mark.parametrize("grams", [0.0, 3.0])
def test_out_of_reach_no_pressure_helps_further(sections: int, kind: str, full: bool, grams: float) -> None:
    """First-order optimality inside the limits, by differences; the error is that of `forward`."""
    engine = solver(rod_of(sections), limits=uneven(sections), full_rotation=full)
    rng, judged, held = np.random.default_rng([4, sections, full]), 0, 0
    limits, force = engine.setup.limits, (0.0, 0.0, grams * GRAM)
    for _ in range(8):
        reach = engine.setup.rod.reach
        tip = rng.uniform((-0.5, -0.5, 0.7), (0.5, 0.5, 1.7)) * reach
        mid = rng.uniform((-20.0, -20.0, 45.0), (20.0, 20.0, 75.0))
        direction = rng.normal(size=3) + np.array([0.0, 0.0, 2.0])
        direction /= np.linalg.norm(direction)
        task = Task(
            (float(tip[0]), float(tip[1]), float(tip[2])),
            (float(mid[0]), float(mid[1]), float(mid[2])) if kind == "mid" else None,
            (float(direction[0]), float(direction[1]), float(direction[2])) if kind == "direction" else None,
            force,
        )
        found = task.solve(engine, limits.centre)
        assert_inside(engine, found)
        if found.met or not found.optimal:
            continue
        judged += 1
        bar = np.array(found.pressures_bar)
        r, J = task.error(engine, bar), task.jacobian(engine, bar)
        assert found.stable
        assert found.balance_nmm < 1e-8
        assert found.residual_mm == pytest.approx(float(np.linalg.norm(r)), abs=2e-6)
        held += int(np.sum((bar == limits.lower) | (bar == limits.upper)))
        slope = pull_inside(engine, bar, J.T @ r)
        assert np.abs(slope).max() < (4e-4 if grams else 5e-5) * found.residual_mm * np.abs(J).max()
    assert judged >= 3
    assert held >= 3


def test_without_a_load_the_bounded_optimum_is_that_of_scipy() -> None:
    """Mid-point and tip out of reach: trf from eight points, judged by `forward`, finds nothing nearer."""
    engine = solver(two(), limits=uneven(2))
    limits, rng = engine.setup.limits, np.random.default_rng(8)
    for tip, mid in (((-20.0, 15.0, 120.0), (8.0, -5.0, 60.0)), ((30.0, 30.0, 150.0), (0.0, 5.0, 70.0))):
        task = Task(tip, mid)
        found = task.solve(engine, limits.lower)
        best = min(
            float(np.linalg.norm(least_squares(
                lambda p, task=task: task.error(engine, p), rng.uniform(limits.lower, limits.upper),
                bounds=(limits.lower, limits.upper), xtol=1e-12, ftol=1e-12,
            ).fun)) for _ in range(8)
        )  # fmt: skip
        assert not found.met
        assert found.residual_mm <= best + 1e-5


@pytest.mark.parametrize("axis", range(6))
@pytest.mark.parametrize("beyond", [-0.02, 0.02])
def test_just_beyond_a_limit_its_axis_is_at_it_exactly(axis: int, beyond: float) -> None:
    """The same just inside it is met, from both sides, and at the limit itself."""
    engine, open_ = solver(rod_of(2), limits=uneven(2)), solver(rod_of(2))
    limits = engine.setup.limits
    bar = limits.centre.copy()
    end = limits.lower[axis] if beyond < 0.0 else limits.upper[axis]
    for off in (beyond, 0.0, -0.05 * beyond):
        bar[axis] = end + off
        task = Task.reached(open_, bar, "mid", (0.0, 0.0, 0.02))
        assert task is not None
        found = task.solve(engine, limits.centre)
        assert_inside(engine, found)
        if off == beyond:
            assert not found.met
            assert found.optimal
            assert found.pressures_bar[axis] == end
            assert found.residual_mm > 10.0 * TOLERANCE
        else:
            assert_met(engine, task, found)
            assert found.pressures_bar == pytest.approx(bar.tolist(), abs=1e-5)


@pytest.mark.parametrize("kind", ["tip", "mid", "direction"])
def test_turned_or_mirrored_targets_have_turned_or_mirrored_pressures(kind: str) -> None:
    """By 120 degrees about the axis pairs take each other's place; in the plane of the first, two swap."""
    engine, rng = solver(two()), np.random.default_rng(12)
    angle = 2.0 * math.pi / 3.0
    about = np.array(
        [[math.cos(angle), -math.sin(angle), 0.0], [math.sin(angle), math.cos(angle), 0.0], [0, 0, 1]]
    )
    mirror = np.diag([1.0, -1.0, 1.0])
    force, judged = (0.004, -0.002, 0.03), 0
    for _ in range(5):
        task = Task.reached(engine, rng.uniform(0.1, 1.1, 6), kind, force)
        assert task is not None
        found = task.solve(engine, np.full(6, 0.5))
        if not found.met:
            continue
        judged += 1
        bar = np.array(found.pressures_bar).reshape(2, 3)
        for by, order in ((about, [2, 0, 1]), (mirror, [0, 2, 1])):
            there = Task(
                _vec(by @ task.tip),
                None if task.mid is None else _vec(by @ task.mid),
                None if task.direction is None else _vec(by @ task.direction),
                _vec(by @ force),
            )
            other = there.solve(engine, np.full(6, 0.5))
            assert other.met
            assert np.array(other.pressures_bar) == pytest.approx(bar[:, order].ravel(), abs=1e-6)
    assert judged >= 3


def _vec(a: Array) -> Vec3:
    x, y, z = a.tolist()
    return x, y, z


def test_next_to_no_load_the_answer_is_that_of_no_load() -> None:
    """Where rounding is more than parts of the load."""
    for sections in (1, 2):
        engine, bar = solver(rod_of(sections)), np.linspace(0.15, 1.2, 3 * sections)
        free = engine.forward(bar.tolist(), ZERO3)
        for decade in (-15.0, -11.0, -7.0, -4.0):
            force = (0.0, 0.0, 10.0**decade * GRAM)
            loaded = engine.forward(bar.tolist(), force)
            assert loaded.stable
            assert math.dist(loaded.tip_mm, free.tip_mm) < 100.0 * 10.0**decade + 1e-9
            task = Task(free.tip_mm, free.mid_mm if sections == 2 else None, None, force)
            found = task.solve(engine, 0.9 * bar + 0.05)
            assert_met(engine, task, found)
            assert found.pressures_bar == pytest.approx(bar.tolist(), abs=10.0**decade + 1e-6)


def test_an_upright_arm_that_buckles_at_every_answer_has_no_stable_one() -> None:
    found = solver(one()).inverse((0.0, 0.0, 55.0), None, None, (0.0, 0.0, -30.0 * GRAM), [0.5] * 3)
    assert not found.stable
    assert_inside(solver(one()), found)
    carried = solver(one()).inverse((0.0, 0.0, 55.0), None, None, (0.0, 0.0, -5.0 * GRAM), [0.5] * 3)
    assert carried.met
    assert carried.stable
