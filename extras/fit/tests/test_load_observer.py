"""The estimate of the tick against a plant by the literal equations, with wrong parameters."""

import itertools

import numpy as np
import pytest

from contid import kernels
from contid.control.tick.tip_feedback import Measurement
from contid.robot_file.pneumatic.simulated import SimulatedArm
from contid_dynamics.arm_statics import arm_solver
from contid_fit.sense.live.load_observer import LoadObserver
from tests.sense.observed import ERRORS, GRAM_N, RATE_HZ, Loaded, Run, calibrated, plant
from tests.sense.plant import shipped_robot

pytestmark = pytest.mark.skipif(kernels.load("cosserat") is None, reason="NumPy takes minutes")

LOADS = 12


@pytest.fixture(scope="module")
def weighed():
    """Errors [g] 1 s after a load was put on, and of the unloaded arm before, over their deviations."""
    rng, body = np.random.default_rng(11), plant()
    robot = calibrated(body, rng)
    run = Run(robot, body, rng)
    errors, shares = [], []
    run.move(rng.uniform(0.05, 1.2, 6))
    for _ in range(LOADS):
        share, load = run.put_on()
        shares.append(share)
        run.rest(1.0)
        force, sigma = run.found()
        errors.append((force - load) / GRAM_N)
        shares.append((force - load) / sigma)
    return robot, np.array(errors), np.array(shares)


@pytest.mark.slow
def test_a_load_is_weighed_within_a_second(weighed):
    rmse = np.sqrt((weighed[1] ** 2).mean(axis=0))
    assert rmse[2] <= 0.5  # along gravity [g]
    assert max(rmse[:2]) <= 0.3


def test_the_intervals_hold_what_they_state(weighed):
    # Of 72 components of one arm; `python -m tests.sense.figures` has more.
    assert 0.88 <= (np.abs(weighed[2]) <= 1.96).mean() <= 1.0


class Creeping(Loaded):
    """The plant whose moduli fall by 3 % in every decade of time after a command, in small steps."""

    age_s, at = 1e4, None

    def follow(self, regulators_pa, t_s=0.0):
        self.age_s = 0.0 if regulators_pa != self.at else self.age_s + 1.0 / RATE_HZ
        self.at = regulators_pa
        decade = round(np.log10(max(self.age_s, 0.3)), 2)
        if decade != getattr(self, "decade", None):
            self.decade = decade
            softer = tuple(
                100.0 * ((1.0 + percent / 100.0) * (1.0 - 0.03 * decade) - 1.0)
                for percent in ERRORS.modulus_percent
            )
            errors = ERRORS.model_copy(update={"modulus_percent": softer})
            sim = SimulatedArm(errors=errors)
            self._solve = arm_solver(shipped_robot().model_copy(update={"sim": sim}))
        super().follow(regulators_pa, t_s)


@pytest.mark.slow
def test_an_arm_that_creeps_is_not_a_load(weighed):
    load = weighed[0].sense.load
    found = load.calibration.model_copy(update={"creep_per_decade": 0.03, "creep_sigma": 0.002})
    sense = weighed[0].sense.model_copy(update={"load": load.model_copy(update={"calibration": found})})
    creeping = weighed[0].model_copy(update={"sense": sense})
    off = []
    for robot in (weighed[0], creeping):
        body = Creeping(shipped_robot().model_copy(update={"sim": SimulatedArm(errors=ERRORS)}))
        run = Run(robot, body, np.random.default_rng(4))
        run.move(np.array([0.2, 1.0, 0.3, 0.9, 0.1, 0.6]))
        run.rest(8.0)
        force, sigma = run.found()
        off.append((np.abs(force) / GRAM_N, np.abs(force) / sigma))
    assert off[0][1].max() > 3.0  # grams that are not there, and sure of them
    assert off[1][1].max() < 3.0
    assert off[1][0].max() < 0.4


def test_the_same_inputs_give_the_same_estimate(weighed):
    def once():
        body = plant()
        run = Run(weighed[0], body, np.random.default_rng(3))
        run.move(np.array([0.2, 0.9, 0.4, 0.6, 0.1, 0.8]), 0.3)
        body.force = (0.0, 0.0, 5.0 * GRAM_N)
        run.rest(0.5)
        return run.observer

    first, second = once(), once()
    assert first.found == second.found


def test_a_load_taken_off_is_seen_as_a_jump(weighed):
    body = plant()
    body.force = (0.0, 0.0, 6.0 * GRAM_N)
    run = Run(weighed[0], body, np.random.default_rng(4))
    run.move(np.array([0.3, 0.5, 0.6, 0.2, 0.4, 0.7]))
    run.rest(1.5)
    assert run.observer.found is not None
    assert run.observer.found.settled
    body.force = (0.0, 0.0, 0.0)
    run.rest(0.06)
    assert run.observer.found is not None
    assert not run.observer.found.settled  # the average begins anew
    run.rest(1.0)
    assert np.abs(run.found()[0]).max() < 0.6 * GRAM_N


def test_without_reports_or_a_tracker_there_is_no_estimate(weighed):
    observer = LoadObserver(weighed[0], 1.0 / RATE_HZ)
    for k in range(50):
        observer.tick(k / RATE_HZ, None, None, Measurement((0.0, 0.0, 0.09), k / RATE_HZ))
    assert observer.found is None
    for k in range(50, 100):
        observer.tick(k / RATE_HZ, (0.5,) * 6, (0.5,) * 6, None)
    assert observer.found is None


@pytest.mark.parametrize("load", ["estimated", "measured"])
def test_stability_under_greater_forces_is_examined_where_the_solver_takes_them(weighed, load):
    """Pulled along its axis the arm is stable under any force; pushed with 20 g it is under none."""
    run = Run(weighed[0].model_copy(update={"load": load}), plant(), np.random.default_rng(5))
    run.move(np.full(6, 0.5), 0.3)
    for grams, stable in ((5.0, True), (-20.0, False)):
        run.body.force = (0.0, 0.0, grams * GRAM_N)
        run.rest(0.8)
        found = run.observer.found
        assert found is not None
        assert (found.held, found.margin) == (stable and load == "estimated",) * 2


@pytest.mark.parametrize(("rate_hz", "parts"), [(1000.0, 1), (500.0, 1), (250.0, 2), (100.0, 5)])
def test_a_tick_does_one_part_of_the_work_and_slower_ones_do_more(weighed, monkeypatch, rate_hz, parts):
    observer = LoadObserver(weighed[0], 1.0 / rate_hz)
    done: list[int] = []
    monkeypatch.setattr(observer, "_work", map(done.append, itertools.count()))
    observer.tick(0.0, None, None, None)
    assert len(done) == parts
