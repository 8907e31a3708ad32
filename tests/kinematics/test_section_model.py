"""Inverse kinematics of sections: reachable, unreachable, limits, closed paths."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from contid.kinematics.arc.feasible import Feasible
from contid.kinematics.arc.section_model import SectionModel, build_solver
from contid.kinematics.model import build_model
from contid.robot_file.document import RobotFile
from contid.robot_file.tri_rack import TriRack
from contid.targets import Target
from tests.kinematics.section_robots import GOLDEN, ROBOTS, one_segment, random_lengths
from tests.oracles import twists


def goal(feasible: Feasible, lengths: np.ndarray, mode: str) -> tuple[Any, ...]:
    at = twists.of_tubes(feasible.sections).placed(lengths)
    direction = tuple(at.rotation[:, 2].tolist()) if mode == "direction" else None
    mid = tuple(at.mid.tolist()) if mode == "mid" else None
    return tuple(at.tip.tolist()), direction, mid


@pytest.mark.parametrize("mode", ["tip", "direction", "mid"])
@pytest.mark.parametrize("name", ROBOTS)
def test_reachable_targets_from_cold_starts(name, mode):
    """The long form (20 000 of each) is benchmarks/arc_ik.py."""
    feasible = ROBOTS[name]()
    if feasible.sections.count == 1 and mode != "tip":
        pytest.skip("one section has no lengths left for it")
    solver = build_solver(feasible)
    count = 300
    seeds = random_lengths(feasible, count, seed=2)
    for lengths, seed in zip(random_lengths(feasible, count), seeds, strict=True):
        tip, direction, mid = goal(feasible, lengths, mode)
        answer = solver.solve(tip, direction, mid, tuple(seed.tolist()))
        found = np.array(answer.lengths)
        assert answer.converged
        assert answer.residual_m <= 1e-6
        assert np.max(feasible.excess(found)) <= 1e-12
        reached = twists.of_tubes(feasible.sections).placed(found)
        assert np.linalg.norm(reached.tip - tip) <= 1e-6
        if mid is not None:
            assert np.linalg.norm(reached.mid - mid) <= 1e-6
        if direction is not None:
            assert np.linalg.norm(reached.rotation[:, 2] - direction) <= 1e-4


def test_the_worked_unreachable_example():
    """Hughes et al. in the reference: the best bounded answer leaves 153.276456009 mm, rack 1 binds."""
    feasible = one_segment()
    lengths, residual, converged, binding, *_ = build_solver(feasible).solve(
        (0.3, 0.0, 0.7), None, None, (0.29, 0.31, 0.3)
    )
    assert residual * 1e3 == pytest.approx(153.276456009, abs=1e-8)
    np.testing.assert_allclose(np.array(lengths) * 1e3, (650, 612.27985, 612.27985), atol=1e-4)
    tip = twists.of_tubes(feasible.sections).placed(np.array(lengths)).tip
    np.testing.assert_allclose(tip * 1e3, (214.980324, 0, 572.464411), atol=1e-4)
    assert not converged
    assert [name for k, name in enumerate(feasible.names) if binding >> k & 1] == ["s1.l1.max"]


@pytest.mark.parametrize("name", ROBOTS)
def test_unreachable_targets_end_at_a_minimum_on_the_limits(name):
    """No feasible direction lowers the error: the optimum of a convex set, checked against random moves."""
    feasible = ROBOTS[name]()
    solver = build_solver(feasible)
    rng = np.random.default_rng(7)
    reach = feasible.upper[0] * feasible.sections.count
    for _ in range(40):
        direction = rng.normal(size=3)
        tip = tuple((1.5 * reach * direction / np.linalg.norm(direction)).tolist())
        lengths, residual, converged, binding, *_ = solver.solve(
            tip, None, None, tuple(feasible.home.tolist())
        )
        assert not converged
        assert binding
        at = np.array(lengths)
        assert np.max(feasible.excess(at)) <= 1e-12
        for other in random_lengths(feasible, 40, seed=11):
            for step in (1e-3, 1e-2, 1e-1):
                moved = np.array(solver.forward(tuple((at + step * (other - at)).tolist())).tip)
                assert np.linalg.norm(moved - tip) >= residual - 1e-9


def golden_tips() -> np.ndarray:
    from studies.singh import golden_trajectory

    return golden_trajectory().tips_m


def test_closed_paths_close_in_the_lengths():
    """The golden trajectory there and back: after the first lap nothing drifts, way there and back agree."""
    feasible = ROBOTS["cbha"]()
    solver = build_solver(feasible)
    path = [tuple(p.tolist()) for p in golden_tips()]
    seed: tuple[float, ...] = tuple((np.array(GOLDEN["traj"]["l0"]) / 1e3).tolist())
    laps = []
    for _ in range(51):
        lap = []
        for tip in (*path, *reversed(path)):
            seed, _, converged, *_ = solver.solve(tip, None, None, seed)
            assert converged
            lap.append(seed)
        laps.append(np.array(lap))
    assert np.abs(laps[-1] - laps[1]).max() < 1e-12  # 1e-9 mm
    there, back = laps[-1][:100], laps[-1][:99:-1]
    assert np.abs(there - back).max() < 1e-5


def shipped(configs: Path, name: str) -> SectionModel:
    file = RobotFile.model_validate(yaml.safe_load((configs / f"{name}.yaml").read_text()))
    (robot,) = file.robots.values()
    model = build_model(robot)
    assert isinstance(model, SectionModel)
    return model


@pytest.mark.parametrize("name", ["trirack", "trirack2", "cbha"])
def test_models_of_the_shipped_files(configs, name):
    model = shipped(configs, name)
    home = tuple(model.feasible.home.tolist())
    pose = model.forward(home)
    solution = model.inverse(Target(tip_m=pose.tip_m), model.lower)
    assert solution.converged
    assert not solution.limited_by
    np.testing.assert_allclose(model.forward(solution.actuation).tip_m, pose.tip_m, atol=1e-6)
    jacobian, travel = model.jacobian(home), np.array(model.upper) - model.lower
    for axis, step in enumerate(1e-5 * travel):
        moved = np.zeros(len(home))
        moved[axis] = step
        ahead, behind = (np.array(model.forward(tuple(home + sign * moved)).tip_m) for sign in (1, -1))
        slope = (ahead - behind) / (2.0 * step)
        assert jacobian[:, axis] == pytest.approx(slope, rel=1e-4, abs=1e-4 * np.abs(jacobian).max())
    line = model.shape(home, 7)
    assert line[0] == pytest.approx((0, 0, 0), abs=1e-12)
    assert line[-1] == pytest.approx(pose.tip_m, abs=1e-9)
    assert np.ptp(np.linalg.norm(np.diff(line, axis=0), axis=1)) < 1e-9  # straight at home: equal steps
    assert pose.direction == pytest.approx((0, 0, 1))
    clamped = model.inverse(Target(actuation=tuple(2 * value for value in model.upper)), home)
    assert not clamped.converged
    assert clamped.limited_by
    assert clamped.residual_m > 0.0
    kept = model.inverse(Target(actuation=home), home)
    assert kept.converged
    assert kept.actuation == home


def test_table_one_envelope(configs):
    """5 to 65 cm for one segment, 5 to 82 cm for two, platform included."""
    for name, shortest, longest in (("trirack", 0.05, 0.65), ("trirack2", 0.05, 0.82)):
        model = shipped(configs, name)
        for z, expected in ((0.0, shortest), (2.0, longest)):
            found = model.inverse(Target(tip_m=(0.0, 0.0, z)), tuple(model.feasible.home.tolist()))
            np.testing.assert_allclose(model.forward(found.actuation).tip_m, (0, 0, expected), atol=1e-6)


@pytest.mark.parametrize(
    ("coupling", "lengths", "motors"),
    [
        ("base_fixed", (300, 280, 320, 250, 260, 240), (300, 280, 320, 550, 540, 560)),
        ("tip_fixed", (300, 280, 320, 250, 260, 240), (550, 540, 560, 250, 260, 240)),
        ("printed", (300, 280, 320, 250, 260, 240), (50, 20, 80, 250, 260, 240)),
        ("printed", (200, 200, 200, 400, 340, 370), (-200, -140, -170, 400, 340, 370)),
    ],
)
def test_motors_of_two_segments(configs, coupling, lengths, motors):
    raw = yaml.safe_load((configs / "trirack2.yaml").read_text())["robots"]["arm"]
    raw["geometry"]["coupling"] = coupling
    robot = TriRack.model_validate(raw)
    assert robot.coupling is not None
    assert (np.array(robot.coupling) @ lengths).tolist() == list(motors)


def test_bend_radius_is_kept_and_named(configs):
    model = shipped(configs, "trirack")
    seed = tuple(model.feasible.home.tolist())
    solution = model.inverse(Target(tip_m=(0.1, 0.0, 0.05)), seed)
    assert not solution.converged
    assert solution.limited_by == ("s1.bend_radius",)
    u, v, length = model.sections.arcs(solution.actuation)[0]
    assert length / math.hypot(u, v) == pytest.approx(0.120, abs=1e-9)


@pytest.mark.parametrize("name", ["trirack", "trirack2", "cbha"])
def test_no_target_leads_outside_the_limits(configs, name):
    """Unreachable, tiny, infinite and NaN targets."""
    model = shipped(configs, name)
    home = tuple(model.feasible.home.tolist())
    tiny, huge = 5e-324, 1e150
    points = [(0, 0, 0), (tiny, 0, 0), (1e-309, 0, -0.02), (0, 0, -0.1), (1e-200, 0, -0.1), (huge, 0, huge)]
    for point in [*points, (0, huge, 0), (math.nan, 0, 0.2), (0, math.inf, 0)]:
        solution = model.inverse(Target(tip_m=point), home)
        assert solution.converged == (solution.residual_m <= 1e-6)  # two segments can curl back to the base
        assert np.isfinite(solution.actuation).all()
        assert np.max(model.feasible.excess(np.array(solution.actuation))) <= 1e-12
