"""The tendon model: reach, limits of travel and tension, settled answers, refused slack, located errors.

Targets are drawn as bends and put into space by rotation matrices of scipy, not by the kinematics under test.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
import yaml
from scipy.optimize import minimize

from contid.errors import BadInputError
from contid.kinematics.tendon.model import TendonModel
from contid.robot_file.load import parse_robot_file
from contid.robot_file.tendon.robot import TendonRobot
from contid.targets import Target
from tests.kinematics.tendon_robots import placed, random_bends, shipped, vec


@pytest.mark.parametrize("name", ["tendon3", "ftdcr_v4"])
@pytest.mark.parametrize("mode", ["tip", "direction", "mid"])
def test_random_reachable_targets_are_met_with_taut_tendons(name, mode):
    model = shipped(name)
    assert model.statics is not None
    straight = (0.0,) * len(model.axis_names)
    for bends in random_bends(model, 100, seed=7):
        tip, tangent, mid = placed(model, bends)
        target = Target(
            tip_m=vec(tip),
            direction=vec(tangent) if mode == "direction" else None,
            mid_m=vec(mid) if mode == "mid" else None,
        )
        solution = model.inverse(target, straight)
        assert solution.converged, solution
        found = placed(model, model.statics.bends(np.array(solution.actuation)))
        assert math.dist(found[0], tip) <= 1e-6
        if mode == "direction":
            assert math.dist(found[1], tangent) <= 2e-5
        if mode == "mid":
            assert math.dist(found[2], mid) <= 1e-6
        tensions = model.tensions(solution.actuation)
        assert tensions is not None
        assert np.min(tensions) >= model.statics.floor_n - 1e-7
        assert np.max(tensions) <= model.statics.limit_n + 1e-7
        assert np.all(np.array(solution.actuation) >= model.lower)
        assert np.all(np.array(solution.actuation) <= model.upper)
        again = model.inverse(target, solution.actuation)
        np.testing.assert_allclose(again.actuation, solution.actuation, rtol=0.0, atol=1e-8)


def test_forward_is_the_chain_of_circles_and_the_jacobian_its_derivative():
    model = shipped()
    for bends in random_bends(model, 20, seed=8):
        assert model.statics is not None
        pulls = tuple(model.statics.pulls(bends).tolist())
        tip, tangent, mid = placed(model, bends)
        pose = model.forward(pulls)
        np.testing.assert_allclose(pose.tip_m, tip, atol=1e-12)
        np.testing.assert_allclose(pose.direction, tangent, atol=1e-12)
        np.testing.assert_allclose(pose.mid_m, mid, atol=1e-12)
        jacobian = model.jacobian(pulls)
        step = 1e-6
        for axis in range(len(pulls)):
            moved = np.array([pulls, pulls])
            moved[:, axis] += (step, -step)
            up, down = (placed(model, model.statics.bends(row))[0] for row in moved)
            np.testing.assert_allclose(jacobian[:, axis], (up - down) / (2 * step), atol=1e-6)


def test_no_other_bends_with_the_same_tip_are_straighter():
    model = shipped()
    assert model.statics is not None
    lengths = np.repeat(model.feasible.sections.backbone_m, 2)
    for bends in random_bends(model, 6, seed=9):
        tip, _, _ = placed(model, bends)
        answer = model.inverse(Target(tip_m=vec(tip)), (0.0,) * 9)
        found = lengths * model.statics.bends(np.array(answer.actuation))
        constraints = [
            {"type": "eq", "fun": lambda x, tip=tip: 100.0 * (placed(model, x / lengths)[0] - tip)},
            {"type": "ineq", "fun": lambda x: -model.feasible.excess(x)},
        ]
        best = minimize(
            lambda x: 0.5 * float(x @ x),
            found,
            constraints=constraints,
            method="SLSQP",
            options={"ftol": 1e-12},
        )
        if best.success and np.linalg.norm(best.x - found) < 0.02:
            assert 0.5 * found @ found <= best.fun + 1e-7


def test_a_slack_tendon_is_refused_and_named():
    model = shipped()
    pulls = [0.0] * 9
    pulls[0] = -0.002  # paid out alone: it would have to push
    refused = model.inverse(Target(actuation=tuple(pulls)), (0.0,) * 9)
    assert not refused.converged
    assert "s1.t1.slack" in refused.limited_by
    assert "taut" in refused.note
    tensions = model.tensions(refused.actuation)
    assert tensions is not None
    assert model.statics is not None
    assert np.min(tensions) >= model.statics.floor_n - 1e-9
    kept = model.inverse(Target(actuation=refused.actuation), (0.0,) * 9)
    assert kept.converged
    assert kept.actuation == refused.actuation


def test_one_tendon_pulled_alone_is_too_tight():
    model = shipped()
    refused = model.inverse(Target(actuation=(0.01, *(0.0,) * 8)), (0.0,) * 9)
    assert not refused.converged
    assert any(limit.endswith(".tension") for limit in refused.limited_by)


def test_out_of_reach_the_answer_stays_taut():
    model = shipped()
    rng = np.random.default_rng(10)
    for _ in range(10):
        away = rng.normal(size=3)
        solution = model.inverse(Target(tip_m=vec(0.6 * away / np.linalg.norm(away))), (0.0,) * 9)
        assert not solution.converged
        assert model.statics is not None
        tensions = model.tensions(solution.actuation)
        assert tensions is not None
        assert np.min(tensions) >= model.statics.floor_n - 1e-7
        assert np.max(tensions) <= model.statics.limit_n + 1e-7


@pytest.mark.parametrize(("count", "tendons"), [(1, 3), (2, 3), (8, 3), (8, 8)])
def test_one_to_eight_sections(configs, count, tendons):
    raw = yaml.safe_load((configs / "tendon3.yaml").read_text())["robots"]["arm"]
    section = raw["geometry"]["sections"][0] | {
        "length_mm": 300.0 / count,
        "angles_deg": [360.0 / tendons * k for k in range(tendons)],
    }
    raw["geometry"]["sections"] = [section] * count
    raw["limits"]["bend_max_deg"] = [300.0 / count]
    raw["tension"]["max_n"] = 200.0
    raw |= {"axes": {}, "placeholder": []}
    del raw["rest_mm"]
    model = TendonModel(TendonRobot.model_validate(raw))
    for bends in random_bends(model, 10, seed=11):
        tip, _, _ = placed(model, bends)
        solution = model.inverse(Target(tip_m=vec(tip)), (0.0,) * (tendons * count))
        assert solution.converged
        assert math.dist(model.forward(solution.actuation).tip_m, tip) <= 1e-6


@pytest.mark.parametrize(
    ("old", "new", "line_has", "message"),
    [
        ("[0, 120, 240]", "[0, 20, 40]", "- {length_mm: 100", "without a tendon"),
        ("[0, 120, 240]", "[0, 120]", "[0, 120]", "three or more tendons"),
        (
            "radius_mm: [8], angles_deg: [0,",
            "radius_mm: [8, 9], angles_deg: [0,",
            "[8, 9]",
            "allowed: 1 or 3",
        ),
        ("[[-45, 45]]", "[[5, 45]]", "", "both sides of 0"),
        ("bend_max_deg: [120]", "bend_max_deg: [120, 90]", "", "1 or 3, one per section"),
        ("max_n: 25", "max_n: 1.5", "max_n", "twice floor_n"),
        ("routing: through", "routing: trough", "routing", "independent"),
        ("floor_n: 1.0", "floor_n: 0", "floor_n", "greater than 0"),
    ],
)
def test_wrong_robot_files_are_refused_where_they_are_wrong(configs, old, new, line_has, message):
    text = (configs / "tendon3.yaml").read_text()
    assert old in text
    broken = text.replace(old, new, 1)
    with pytest.raises(BadInputError) as refused:
        parse_robot_file(broken, "tendon3.yaml")
    report = str(refused.value)
    assert message in report
    line = int(report.split("tendon3.yaml:")[1].split(":")[0])
    assert line_has in broken.splitlines()[line - 1]


def test_a_target_that_the_length_keeps_out_of_reach_names_it() -> None:
    """Beyond the straight robot no limit of pulls, tensions or bends binds."""
    model, rng = shipped("tendon3"), np.random.default_rng(3)
    straight = (0.0,) * len(model.axis_names)
    for _ in range(100):
        side = rng.normal(size=3)
        tip = rng.uniform(0.35, 0.5) * side / np.linalg.norm(side) * [1.0, 1.0, np.sign(side[2])]
        missed = model.inverse(Target(tip_m=vec(tip)), straight)
        assert not missed.converged
        assert missed.limited_by
    assert model.inverse(Target(tip_m=(0.0, 0.0, 0.4)), straight).limited_by == ("length",)


def test_the_shape_of_a_robot_whose_tip_is_behind_its_last_disc_covers_the_whole_backbone(configs) -> None:
    raw = yaml.safe_load((configs / "tendon3.yaml").read_text())["robots"]["arm"]
    raw["geometry"]["tip_offset_mm"] = [0.0, 0.0, -20.0]
    model = TendonModel(TendonRobot.model_validate(raw))
    actuation = model.of_arcs((0.5, 0.2, 0.0) * 3, (0.0,) * 9)
    shape = model.shape(actuation, 41)
    geometry = model.geometry
    whole_m = geometry.base_offset_m + sum(each.length_m + each.rigid_m for each in geometry.sections)
    steps = np.linalg.norm(np.diff(shape[:-1], axis=0), axis=1)
    np.testing.assert_allclose(steps, whole_m / 40, rtol=1e-3)
    assert shape[-1] == pytest.approx(model.forward(actuation).tip_m)
