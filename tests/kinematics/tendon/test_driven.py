"""Drives that wind several tendons: statics by minimal energy, lengths of drawn tendons, limits, targets."""

from __future__ import annotations

import math

import numpy as np
import pytest
import yaml
from scipy.optimize import minimize

from contid.control.tick.shared_limits import SharedLimits
from contid.errors import BadInputError
from contid.kinematics.model import build_model
from contid.robot_file.load import load_named, parse_robot_file
from contid.robot_file.tendon.robot import TendonRobot
from contid.targets import Target
from contid_tendons.driven import DrivenTendonModel
from tests.kinematics.tendon.trunk_slack import search

PRESETS = ("catheter", "planar2", "trunk")


def described(name: str) -> TendonRobot:
    (robot,) = load_named(name).file.robots.values()
    assert isinstance(robot, TendonRobot)
    return robot


def driven(name: str) -> DrivenTendonModel:
    model = build_model(described(name))
    assert isinstance(model, DrivenTendonModel)
    return model


def travels(model: DrivenTendonModel, count: int, seed: int) -> list[tuple[float, ...]]:
    """Travels inside every limit, dense up to the limits."""
    rng = np.random.default_rng(seed)
    rows = rng.uniform(model.lower, model.upper, (count, len(model.lower)))
    return [model.inverse(Target(actuation=tuple(row)), tuple(row)).actuation for row in rows.tolist()]


def drawn_length_m(model: DrivenTendonModel, bends: np.ndarray, section: int, azimuth_rad: float) -> float:
    """Length of a tendon that runs along a chain of arcs at the distance of its section, as a polyline."""
    points, at, frame = [], np.zeros(3), np.eye(3)
    offset = model.geometry.sections[section].radius_m[0] * np.array(
        [math.cos(azimuth_rad), math.sin(azimuth_rad), 0.0]
    )
    steps = 2000
    for k in range(section + 1):
        u, v = bends[2 * k : 2 * k + 2] / steps
        turn, ds = math.hypot(u, v), model.geometry.sections[k].length_m / steps
        axis = np.array([-v, u, 0.0]) / (turn or 1.0)
        cross = np.cross(np.eye(3), axis)
        step = np.eye(3) + math.sin(turn) * cross + (1.0 - math.cos(turn)) * cross @ cross
        for _ in range(steps):
            points.append(at + frame @ offset)
            half = frame @ (np.eye(3) + 0.5 * turn * cross)
            at, frame = at + ds * half[:, 2], frame @ step
    points.append(at + frame @ offset)
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


@pytest.mark.parametrize("name", ["catheter", "planar2"])
def test_a_drive_winds_in_what_its_tendon_shortens_by(name):
    model, robot = driven(name), described(name)
    assert robot.drives is not None
    (row,) = travels(model, 1, seed=4)
    bends = model.bends(row)
    for travel, drive in zip(row, robot.drives.values(), strict=True):
        for tendon, ratio in drive.pulls.items():
            section, number = (int(part[1:]) - 1 for part in tendon.split("."))
            azimuth = math.radians(robot.geometry.sections[section].angles_deg[number])
            straight = sum(model.geometry.sections[k].length_m for k in range(section + 1))
            wound_m = straight - drawn_length_m(model, bends, section, azimuth)
            assert ratio * travel == pytest.approx(wound_m, abs=1e-7)


def test_bends_and_tensions_have_the_least_energy():
    model, robot = driven("trunk"), described("trunk")
    tension = robot.tension
    assert tension is not None
    assert tension.spring_n_per_mm is not None
    pretension_n = tension.pretension_n
    assert pretension_n is not None
    series = 1e3 / (1.0 / tension.tendon_n_per_mm[0] + 1.0 / tension.spring_n_per_mm[0])
    stiff = np.repeat(tension.bending_n_mm2, 2) * 1e-6 / 0.106
    (row,) = travels(model, 1, seed=6)
    assert robot.drives is not None
    pulls, arms = [], []
    for number, name in enumerate(robot.tendon_names):
        section = number // 4
        azimuth = math.radians(robot.geometry.sections[section].angles_deg[number % 4])
        arms.append((section, 0.025 * math.cos(azimuth), 0.025 * math.sin(azimuth)))
        pulls.append(sum(d.pulls.get(name, 0.0) * m for d, m in zip(robot.drives.values(), row, strict=True)))

    def stretches(bends: np.ndarray) -> np.ndarray:
        sums = np.cumsum(bends.reshape(3, 2), axis=0)
        return np.array(
            [q - x * sums[s, 0] - y * sums[s, 1] for q, (s, x, y) in zip(pulls, arms, strict=True)]
        )

    def energy(bends: np.ndarray) -> float:
        stretch = stretches(bends) + pretension_n / series
        return float(0.5 * series * stretch @ stretch + 0.5 * (stiff * bends) @ bends)

    found = minimize(energy, np.zeros(6), method="BFGS", options={"gtol": 1e-10}).x
    np.testing.assert_allclose(model.bends(row), found, atol=1e-6)
    tensions = model.tensions(row)
    assert tensions is not None
    np.testing.assert_allclose(tensions, pretension_n + series * stretches(found), rtol=1e-5)


@pytest.mark.parametrize("name", PRESETS)
def test_targets_in_reach_are_met_inside_every_limit(name):
    model, robot = driven(name), described(name)
    rest = (0.0,) * len(model.axis_names)
    for row in travels(model, 100, seed=7):
        tip = model.forward(row).tip_m
        found = model.inverse(Target(tip_m=tip), rest)
        assert found.converged
        assert "drives" not in found.limited_by
        assert math.dist(model.forward(found.actuation).tip_m, tip) < 1e-6
        assert np.all(np.array(model.lower) <= found.actuation)
        assert np.all(np.array(model.upper) >= found.actuation)
        tensions = model.tensions(found.actuation)
        if tensions is not None and robot.tension is not None:
            assert tensions.min() >= robot.tension.floor_n - 1e-6
            assert tensions.max() <= robot.tension.max_n + 1e-6


def test_answers_out_of_reach_of_a_plane_stay_in_it_and_name_why():
    model = driven("planar2")
    found = model.inverse(Target(tip_m=(0.05, 0.03, 0.15)), (0.0, 0.0))
    assert not found.converged
    assert model.forward(found.actuation).tip_m[1] == pytest.approx(0.0, abs=1e-12)
    assert found.residual_m >= 0.03 - 1e-6
    across = model.inverse(Target(arcs=(0.3, 0.2, 0.0, 0.1, 0.0, 0.0)), (0.0, 0.0))
    assert not across.converged
    assert across.note == "no actuation has these bends"
    along = model.inverse(Target(arcs=(0.3, 0.0, 0.0, -0.1, 0.0, 0.0)), (0.0, 0.0))
    assert along.converged
    np.testing.assert_allclose(model.bends(along.actuation), (0.3, 0.0, -0.1, 0.0), atol=1e-12)


def test_a_slack_tendon_is_named():
    robot = described("trunk")
    assert robot.tension is not None
    weak = robot.model_copy(update={"tension": robot.tension.model_copy(update={"pretension_n": 1.5})})
    model = build_model(weak)
    refused = model.inverse(Target(actuation=model.upper), (0.0,) * 6)
    assert not refused.converged
    assert any(name.endswith(".slack") for name in refused.limited_by)
    assert isinstance(model, DrivenTendonModel)
    tensions = model.tensions(refused.actuation)
    assert tensions is not None
    assert tensions.min() >= robot.tension.floor_n - 1e-9


@pytest.mark.parametrize("name", PRESETS)
def test_shared_limits_have_their_slopes_and_are_the_limits(name):
    model = driven(name)
    shared: SharedLimits = model.shared
    for row in travels(model, 5, seed=8):
        assert max(shared.excess(row)) <= 1e-9
        for number in range(len(shared.excess(row))):
            slope = np.array(shared.gradient(row, number))
            assert np.abs(slope).max() <= 2.0
            for axis in range(len(row)):
                up, down = (
                    tuple(v + (h if k == axis else 0.0) for k, v in enumerate(row)) for h in (1e-6, -1e-6)
                )
                change = shared.excess(up)[number] - shared.excess(down)[number]
                assert change / 2e-6 == pytest.approx(slope[axis], abs=1e-5)


@pytest.mark.parametrize(
    ("name", "old", "new", "line_has", "message"),
    [
        ("catheter", "s1.t3: -1", "s1.t5: -1", "s1.t5", "no tendon 's1.t5'"),
        ("catheter", "{s1.t1: 1, s1.t3: -1}", "{s1.t1: 1}", "m1:", "no drive pulls s1.t3"),
        ("catheter", "s1.t3: -1", "s1.t3: 1", "s1.t3: 1", "no bend of the backbone"),
        ("catheter", "s1.t3: -1", "s1.t3: 0", "s1.t3: 0", "moves nothing"),
        ("catheter", "travel_mm: [-12, 12]", "travel_mm: [1, 12]", "[1, 12]", "both sides of 0"),
        ("planar2", "[0, 180]}", "[0, 120]}", "[0, 120]", "face each other"),
        ("trunk", "      pretension_n: 30\n", "", "floor_n", "pretension_n is missing"),
        ("trunk", "pretension_n: 30", "pretension_n: 80", "pretension_n", "not between floor_n"),
        ("catheter", "id: 2,", "id: 2, homing: {method: tension, direction: 1},", "homing", "winds single"),
        ("bend1", "angles_deg: [0, 120, 240]", "angles_deg: [0, 180]", "[0, 180]", "or drives"),
        ("bend1", "      pull_mm: [[-18, 18]]\n", "", "bend_max", "pull_mm is missing"),
    ],
)  # fmt: skip
def test_wrong_drives_are_refused_where_they_are_wrong(configs, name, old, new, line_has, message):
    text = (configs / f"{name}.yaml").read_text()
    assert old in text
    broken = text.replace(old, new, 1)
    with pytest.raises(BadInputError) as refused:
        parse_robot_file(broken, "robot.yaml")
    report = str(refused.value)
    assert message in report
    line = int(report.split("robot.yaml:")[1].split(":")[0])
    assert line_has in broken.splitlines()[line - 1]


def test_any_ratios_are_fine_where_tendons_are_elastic(configs):
    text = (configs / "trunk.yaml").read_text()
    shared = text.replace("{s2.t4: 1, s2.t2: -1}", "{s2.t4: 1, s2.t2: -1, s3.t1: 0.5}")
    assert shared != text
    parse_robot_file(shared, "robot.yaml")


def test_drives_that_bend_alike_are_refused(configs):
    raw = yaml.safe_load((configs / "catheter.yaml").read_text())
    arm = raw["robots"]["arm"]
    arm["drives"]["m2"]["pulls"] = {"s1.t1": -0.5, "s1.t3": 0.5}
    arm["drives"]["m1"]["pulls"] |= {"s1.t2": 1, "s1.t4": -1}
    arm["drives"]["m2"]["pulls"] |= {"s1.t2": -0.5, "s1.t4": 0.5}
    with pytest.raises(BadInputError, match="in the same way"):
        parse_robot_file(yaml.safe_dump(raw), "robot.yaml")


def test_no_tendon_of_the_trunk_goes_slack():
    found = search(400, seed=1)
    assert found.wrong == 0
    assert found.met > 350
