"""The estimate of the tick beside a plant by the literal equations, with wrong parameters."""

import json

import numpy as np

from contid.control.tick.tip_feedback import Measurement
from contid.robot_file.pneumatic.sense import LoadSensing, ModelErrors, Sense
from contid.robot_file.pneumatic.simulated import SimulatedArm, SimulatedErrors
from contid_dynamics.arm_body import SimulatedBody
from contid_fit.sense import HysteresisSides, calibrate_without_load, rod_family
from contid_fit.sense.live.load_observer import LoadObserver
from contid_fit.sense.written import calibration_keys
from tests.sense.plant import shipped_model, shipped_robot

GRAM_N = 9.80665e-3
RATE_HZ, TRACKER_TICKS = 250.0, 5
NOISE_M, LATENCY_S = 3e-4, 0.01
ERRORS = SimulatedErrors(
    modulus_percent=(4.0, -3.0), moment_percent=-2.0, regulator_bar=0.03, hysteresis_bar=0.03
)


class Loaded(SimulatedBody):
    """The plant under any force."""

    force = (0.0, 0.0, 0.0)

    def payload_n(self, t_s):
        return self.force


def plant():
    return Loaded(shipped_robot().model_copy(update={"sim": SimulatedArm(errors=ERRORS)}))


def pascal(bar):
    return (np.asarray(bar) * 1e5).tolist()


def calibrated(body, rng, poses=30):
    """The arm with what a session without load writes into its file."""
    sides = HysteresisSides(shipped_model())
    sides.to((0.0,) * 6)
    body.follow([0.0] * 6)
    rows, on, tips = [], [], []
    noise_m = NOISE_M / 50**0.5
    for _ in range(poses):
        bar = pascal(rng.uniform(0.05, 1.2, 6))
        body.follow(bar)
        rows.append(bar)
        on.append(sides.to(tuple(bar)))
        tips.append(np.array(body.tip_in_world_m(0.0)) + rng.normal(0.0, noise_m, 3))
    robot = shipped_robot()
    found = calibrate_without_load(rod_family(robot), np.array(rows), np.array(on), np.array(tips), noise_m)
    keys = json.loads(json.dumps(calibration_keys(robot, found)))
    return robot.model_copy(update={"sense": Sense(load=LoadSensing(calibration=ModelErrors(**keys)))})


class Run:
    """Ticks of an observer beside the plant; the tracker has a latency, the regulators noise."""

    def __init__(self, robot, body, rng):
        self.observer = LoadObserver(robot, 1.0 / RATE_HZ)
        self.body, self.rng = body, rng
        self.bar = np.full(6, 0.5)
        self.ticks, self.newest, self.coming = 0, None, []

    def tick(self, bar):
        self.bar = bar
        self.ticks += 1
        now = self.ticks / RATE_HZ
        self.body.follow(pascal(bar))
        if self.ticks % TRACKER_TICKS == 0:
            tip = np.array(self.body.tip_in_world_m(0.0)) + self.rng.normal(0.0, NOISE_M, 3)
            self.coming.append((now + LATENCY_S, Measurement(tuple(tip.tolist()), now)))
        if self.coming and self.coming[0][0] <= now:
            self.newest = self.coming.pop(0)[1]
        reported = tuple((bar + self.rng.normal(0.0, 0.003, 6)).tolist())
        self.observer.tick(now, reported, tuple(bar.tolist()), self.newest)

    def rest(self, seconds):
        for _ in range(round(seconds * RATE_HZ)):
            self.tick(self.bar)

    def move(self, goal, seconds=1.0):
        start, count = self.bar, round(seconds * RATE_HZ)
        for k in range(1, count + 1):
            s = k / count
            self.tick(start + (goal - start) * (3.0 * s * s - 2.0 * s**3))

    def put_on(self):
        """Rest unloaded, then put on a load: the estimate before it over its deviations, and the load."""
        self.body.force = (0.0, 0.0, 0.0)
        self.move(self.rng.uniform(0.05, 1.2, 6))
        self.rest(1.0)
        force, sigma = self.found()
        load = np.array([*self.rng.uniform(-2.0, 2.0, 2), self.rng.uniform(0.0, 10.0)]) * GRAM_N
        self.body.force = tuple(load.tolist())
        return force / sigma, load

    def found(self):
        found = self.observer.found
        assert found is not None
        sigma = np.sqrt(np.diag(np.array(found.covariance).reshape(3, 3)))
        return np.array(found.force_in_base), sigma
