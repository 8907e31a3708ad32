"""Loads of a plant by another formulation and with wrong parameters, as errors and intervals; the command."""

import json
import math
import subprocess
import sys

import numpy as np
import pytest

from contid.targets import ZERO3
from contid_fit.sense import (
    CalibrationError,
    HysteresisSides,
    LoadEstimator,
    calibrate_without_load,
    rod_family,
)
from contid_fit.sense.creep import Drifts
from tests.sense.plant import NOISE_M, RATE_HZ, Plant, pascal, random_pressures, shipped_model, shipped_robot

pytestmark = pytest.mark.process

GRAM_N = 9.80665e-3
CALIBRATION_POSES = 24
LOADS = 16


def estimated(estimator):
    found = estimator.estimate()
    assert found is not None
    return found


def calibrated(plant, rng, poses=CALIBRATION_POSES):
    play = HysteresisSides(plant.model)
    play.to(pascal(np.zeros(6)))
    actuations, sides, tips = [], [], []
    for _ in range(poses):
        bar = random_pressures(rng)
        plant.command(bar)
        actuations.append(pascal(bar))
        sides.append(play.to(pascal(bar)))
        tips.append(plant.measurements(ZERO3, 1.0).mean(axis=0))
    noise = NOISE_M / RATE_HZ**0.5
    calibration = calibrate_without_load(
        rod_family(shipped_robot()), np.array(actuations), np.array(sides), np.array(tips), noise
    )
    return calibration, pascal(bar)


def weigh(plant, loads, poses=CALIBRATION_POSES):
    """Errors and half intervals [g] of static loads: 0 to 10 g along gravity and up to 2 g sideways."""
    rng = np.random.default_rng(5)
    calibration, last = calibrated(plant, rng, poses)
    estimator = LoadEstimator(calibration, NOISE_M)
    estimator.command(last)
    errors, intervals = [], []
    for k in range(loads):
        bar = random_pressures(rng)
        plant.command(bar)
        force = np.array([*rng.uniform(-2.0, 2.0, 2), rng.uniform(0.0, 10.0)]) * GRAM_N
        estimator.clear()
        for i, tip in enumerate(plant.measurements(force, 1.0)):
            estimator.add(10.0 * k + i / RATE_HZ, pascal(bar), tuple(tip.tolist()))
        found = estimated(estimator)
        assert found.converged
        errors.append((np.array(found.force_n) - force) / GRAM_N)
        intervals.append(np.array(found.interval_n) / GRAM_N)
    return calibration, np.array(errors), np.array(intervals)


@pytest.fixture(scope="module")
def weighed():
    return weigh(Plant(1), LOADS)


def test_the_wrong_parameters_are_found(weighed):
    calibration = weighed[0]
    assert calibration.family.names[:4] == ("s1.modulus", "s2.modulus", "s1.moment", "s2.moment")
    assert calibration.parameters[:4] == pytest.approx([0.04, -0.03, -0.02, -0.02], abs=0.01)
    sigma = np.sqrt(np.diag(calibration.covariance))[-4:]
    assert (np.abs(calibration.parameters[4:]) <= 3.0 * sigma + 1e-9).all()  # it weighs nothing
    assert calibration.before_m > 5e-3
    assert calibration.residual_m < 2e-4


def test_static_loads_are_weighed_within_a_second(weighed):
    rmse = np.sqrt((weighed[1] ** 2).mean(axis=0))
    assert rmse[2] <= 0.5  # along gravity [g]
    assert max(rmse[:2]) <= 0.3


def test_the_intervals_hold_what_they_state(weighed):
    _, errors, intervals = weighed
    # Of 48 components, of one arm: too few for a bound near 99 %.
    assert 0.9 <= (np.abs(errors) <= intervals).mean() <= 1.0
    assert np.median(intervals[:, 2]) < 1.0


def test_an_arm_that_weighs_what_its_file_leaves_out():
    calibration, errors, intervals = weigh(Plant(2, density_kg_m3=1070.0, link_g=1.5), 8)
    assert calibration.before_m > 0.03
    assert calibration.residual_m < 2e-4
    assert calibration.parameters[:4] == pytest.approx([0.04, -0.03, -0.02, -0.02], abs=0.03)
    found = dict(zip(calibration.family.names, calibration.parameters, strict=True))
    assert found["s2.density"] == pytest.approx(1070.0, rel=0.05)
    assert np.sqrt((errors[:, 2] ** 2).mean()) <= 0.5  # along gravity [g]
    assert (np.abs(errors) <= intervals).mean() >= 0.85


CREEP = 0.03
GROWING_S = 0.5 + np.arange(75) / RATE_HZ


def of_a_creeping_arm(plant, rng, poses, creeps):
    play = HysteresisSides(plant.model)
    play.to(pascal(np.zeros(6)))
    actuations, sides, rests = [], [], []
    for _ in range(poses):
        bar = random_pressures(rng)
        plant.command(bar)
        actuations.append(pascal(bar))
        sides.append(play.to(pascal(bar)))
        tips = plant.creeping(ZERO3, CREEP, GROWING_S)
        rests.append((GROWING_S, tips + rng.normal(0.0, NOISE_M, tips.shape)))
    means = np.array([tips.mean(axis=0) for _, tips in rests])
    drifts = Drifts.of(rests, NOISE_M) if creeps else None
    noise = NOISE_M / len(GROWING_S) ** 0.5
    family = rod_family(shipped_robot())
    calibration = calibrate_without_load(family, np.array(actuations), np.array(sides), means, noise, drifts)
    return calibration, pascal(bar)


@pytest.mark.campaign
@pytest.mark.parametrize(("seed", "draw", "creeps"), [(1, 5, True), (3, 1003, True), (1, 5, False)])
def test_an_arm_that_weighs_something_and_creeps(seed, draw, creeps):
    """Poses of 1 s to 5 min; without the creep in the calibration the intervals hold a tenth.

    A load of arm 3 is one whose first step buckles the model.
    """
    plant, rng = Plant(seed, density_kg_m3=1070.0, link_g=1.5), np.random.default_rng(draw)
    calibration, last = of_a_creeping_arm(plant, rng, 40, creeps)
    estimator, errors, held = LoadEstimator(calibration, NOISE_M), [], []
    estimator.command(last)
    for k in range(30):
        bar = random_pressures(rng)
        plant.command(bar)
        force = np.array([*rng.uniform(-2.0, 2.0, 2), rng.uniform(0.0, 10.0)]) * GRAM_N
        ages = 10.0 ** rng.uniform(0.0, 2.5) + np.arange(50) / RATE_HZ
        estimator.clear()
        tips = plant.creeping(force, CREEP, ages)
        tips += rng.normal(0.0, NOISE_M, tips.shape)
        for age, tip in zip(ages.tolist(), tips.tolist(), strict=True):
            estimator.add(1000.0 * k + age, pascal(bar), tuple(tip), age)
        found = estimated(estimator)
        assert found.converged or not creeps
        errors.append((np.array(found.force_n) - force) / GRAM_N)
        held.append(np.abs(errors[-1]) <= np.array(found.interval_n) / GRAM_N)
    if creeps:
        assert np.abs(np.array(errors)[:, 2]).max() <= 1.0
        assert 0.9 <= np.mean(held) <= 0.99
    else:
        assert np.mean(held) < 0.3


def test_the_drift_at_rests_gives_the_creep():
    plant, rng = Plant(1, density_kg_m3=1070.0, link_g=1.5), np.random.default_rng(5)
    creep = of_a_creeping_arm(plant, rng, 18, True)[0].creep
    # The plant grows with log10(1 + age/0.1 s): 0.0279 of its modulus from 0.5 to 2 s.
    assert creep.per_decade == pytest.approx(0.0275, abs=0.0015)
    assert creep.sigma < 0.004


class Turned(Plant):
    """An arm whose tracker has a frame that is turned about the base."""

    def __init__(self, seed, turned_deg):
        super().__init__(seed)
        self.cos, self.sin = math.cos(math.radians(turned_deg)), math.sin(math.radians(turned_deg))

    def tip_m(self, force_n, start=None):
        x, y, z = super().tip_m(force_n, start)
        return np.array([self.cos * x - self.sin * y, self.sin * x + self.cos * y, z])


@pytest.mark.parametrize(
    ("turned_deg", "poses", "why"),
    [
        (30.0, 20, "the tips differ by 35.* mm .* from every model of the arm"),
        (60.0, 20, "s2.modulus .* standard deviations from the file"),
        pytest.param(90.0, 20, "standard deviations from the file", marks=pytest.mark.campaign),
        pytest.param(90.0, 18, "standard deviations from the file", marks=pytest.mark.campaign),
    ],
)
def test_what_no_parameter_explains_is_refused(turned_deg, poses, why):
    """A tracker whose frame is turned: no arm bends like that. From a quarter turn on the model buckles."""
    with pytest.raises(CalibrationError, match=why):
        calibrated(Turned(1, turned_deg), np.random.default_rng(5), poses)


def test_without_the_calibration_the_wrong_model_would_be_a_load(weighed):
    """The same tips with the uncorrected model: the load it reports is no load at all."""
    plant = Plant(1)
    bar = np.array([0.2, 0.4, 0.6, 0.1, 0.1, 0.8])
    plant.command(bar)
    tip = plant.tip_m(ZERO3)
    shift = tip - np.array(shipped_model().forward(pascal(bar)).tip_m)
    force = np.linalg.solve(shipped_model().compliance(pascal(bar)), shift) / GRAM_N
    assert np.linalg.norm(force) > 1.0
    estimator = LoadEstimator(weighed[0], NOISE_M)
    estimator.add(0.0, pascal(bar), tuple(tip.tolist()))
    found = estimated(estimator)
    assert np.linalg.norm(found.force_n) / GRAM_N < np.linalg.norm(found.interval_n) / GRAM_N


#: 99.9 % of the chi-squared distribution of three components.
CHI2 = 16.3


def test_sides_of_hysteresis_that_are_not_known_are_in_the_interval(weighed):
    """A new estimator does not know from where an arm came; loads of 2 g stood beside intervals of 0.6 g."""
    plant, rng = Plant(1), np.random.default_rng(6)
    for _ in range(6):
        bar = random_pressures(rng)
        plant.command(bar)
        estimator = LoadEstimator(weighed[0], NOISE_M)
        force = np.array([0.0, 0.0, 5.0]) * GRAM_N
        for i, tip in enumerate(plant.measurements(force, 1.0)):
            estimator.add(i / RATE_HZ, pascal(bar), tuple(tip.tolist()))
        found = estimated(estimator)
        error = np.array(found.force_n) - force
        assert error @ np.linalg.solve(found.covariance, error) < CHI2


def test_a_side_is_known_once_an_axis_went_through_its_loop():
    sides = HysteresisSides(shipped_model())
    first, small, large = sides.to(pascal([0.5] * 6)), sides.to(pascal([0.505] * 6)), (0.6, 0.4, *[0.51] * 4)
    assert np.isnan([*first, *small]).all()
    known = sides.to(pascal(large))
    assert known[:2] == pytest.approx([1.0, -1.0])
    assert np.isnan(known[2:]).all()
    back = sides.to(pascal(np.array(large) - 0.015))
    assert back[:2] == pytest.approx([0.0, -1.0], abs=1e-9)


def test_a_load_is_found_from_one_at_which_the_arm_would_almost_buckle():
    """From the load before, steps end where the model buckles: the answer was 10 g off, and had converged."""
    robot, rng = shipped_robot(), np.random.default_rng(0)
    family = rod_family(robot)
    arm = family.build(np.array([0.0, 0.0, 0.0, 0.0, 1070.0, 1070.0, 1.5, 0.0]))
    play = HysteresisSides(arm)
    play.to(pascal(np.zeros(6)))
    commands = [pascal(random_pressures(rng)) for _ in range(30)]
    sides = [play.to(each) for each in commands]
    tips = np.array([arm.forward(each).tip_m for each in commands]) + rng.normal(0.0, 4e-5, (30, 3))
    calibration = calibrate_without_load(family, np.array(commands), np.array(sides), tips, 4e-5)
    estimator, on = LoadEstimator(calibration, NOISE_M), (1.0,) * 6
    before = [0.592, 0.841, 0.44, 1.116, 1.039, 0.402], np.array([-1.84, 1.07, -5.04]) * GRAM_N
    after = [0.432, 0.716, 1.199, 0.395, 0.589, 0.772], np.array([0.73, -1.15, 5.95]) * GRAM_N
    for t_s, (bar, force) in enumerate((before, after)):
        used = calibration.corrected(pascal(bar), on)
        tip = calibration.model.forward(used, tuple(force.tolist())).tip_m
        estimator.add_at(10.0 * t_s, pascal(bar), on, tip)
        found = estimated(estimator)
        assert found.converged
        assert found.force_n == pytest.approx(force, abs=0.5 * GRAM_N)


def test_the_same_measurements_give_the_same_estimate_and_time_grows(weighed):
    def run():
        estimator = LoadEstimator(weighed[0], NOISE_M)
        for i in range(20):
            estimator.add(i / 50, pascal([0.2, 0.4, 0.6, 0.1, 0.1, 0.8]), (0.01, 0.02 + 1e-4 * (i % 3), 0.09))
        return estimator

    first, second = run(), run()
    assert estimated(first).force_n == estimated(second).force_n
    with pytest.raises(ValueError, match="after one at"):
        first.add(0.1, (0.0,) * 6, ZERO3)
    assert LoadEstimator(weighed[0], NOISE_M).estimate() is None


def test_more_measurements_do_not_shrink_the_error_of_the_model(weighed):
    few, many = (LoadEstimator(weighed[0], NOISE_M, window_s=1e3) for _ in range(2))
    bar = pascal([0.3, 0.3, 0.5, 0.2, 0.4, 0.6])
    tip = weighed[0].model.forward(weighed[0].corrected(bar, (0.0,) * 6)).tip_m
    for i in range(50):
        few.add(i / 50, bar, tip)
    for i in range(5000):
        many.add(i / 50, bar, tip)
    assert estimated(many).interval_n[2] > 0.3 * estimated(few).interval_n[2]


def test_too_few_poses_are_refused():
    poses, tips = np.zeros((5, 6)), np.zeros((5, 3))
    with pytest.raises(CalibrationError, match="5 poses without load; at least 18 are needed for 6 axes"):
        calibrate_without_load(rod_family(shipped_robot()), poses, poses, tips, 1e-4)


def recorded(path, plant, poses, force_n):
    """A session with rests of about a second, the tips of the plant as measurements."""
    axes = [f"s{i}.p{j}_bar" for i in (1, 2) for j in (1, 2, 3)]
    lines = [",".join(["t_s", *axes, "meas.x_mm", "meas.y_mm", "meas.z_mm"])]
    t, way_s = 0.0, 1.2
    plant.command(np.zeros(6))  # the rest pose, where the run begins
    for bar in poses:
        plant.command(bar)
        # Rows 1 ms apart at the ends of a rest keep the cubic from swinging over.
        tips = plant.measurements(force_n, 1.2) * 1e3
        times = np.sort([*(np.arange(len(tips) - 2) / RATE_HZ), 1e-3, (len(tips) - 3) / RATE_HZ - 1e-3])
        for at, tip in zip(t + way_s + times, tips, strict=True):
            lines.append(f"{at:.3f}," + ",".join(f"{v:.6f}" for v in [*bar, *tip]))
        t += way_s + 1.2
    csv = path.with_suffix(".csv")
    csv.write_text("\n".join(lines) + "\n")
    command = [sys.executable, "-m", "contid", "run", "stiffflop2", "--virtual", "--rate", "50"]
    command += ["--trajectory", str(csv), "--record", str(path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=200)
    assert done.returncode == 0, done.stderr
    return path


def test_the_command_weighs_a_recorded_session(tmp_path):
    plant, rng = Plant(3), np.random.default_rng(8)
    empty = recorded(tmp_path / "empty.mcap", plant, [random_pressures(rng) for _ in range(18)], ZERO3)
    force = (0.0, 0.0, 5.0 * GRAM_N)
    loaded = recorded(tmp_path / "loaded.mcap", plant, [random_pressures(rng) for _ in range(3)], force)
    command = [sys.executable, "-m", "contid", "session", "load", str(loaded)]
    done = subprocess.run(
        [*command, "--unloaded", str(empty), "--json"], capture_output=True, text=True, timeout=200
    )
    assert done.returncode == 0, done.stderr
    found = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(found) == 3
    for each in found:
        assert each["mass_g"] == pytest.approx(5.0, abs=max(1.0, 1.5 * each["mass_interval_g"]))
    assert "18 rests without load" in done.stderr
    few = subprocess.run([*command, "--unloaded", str(loaded)], capture_output=True, text=True, timeout=200)
    assert few.returncode == 2
    assert "3 poses without load; at least 18" in few.stderr
