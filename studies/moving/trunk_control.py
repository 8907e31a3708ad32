"""Jumps and figures of eight of a real trunk's twin: commands alone, led, and led with feedback.

    python -m studies.moving.trunk_control

Twin: fitted to ``trunk-dynamic/random_a_*g`` of StanfordASL/trunk-stack (MIT, (c) 2024 Stanford Autonomous
Systems Lab; README of ``../shared/data/moving``): a polynomial of third degree from the six motors to the tip,
then the dead time, a lag and one mode, the same for all directions. A twin for each payload; its frequency is
0.8, 1 or 1.2 times what was fitted. What commands it has the model of 0 g and the fitted frequency.

Feedback with a dead time of 0.22 s cannot wait for an error at 0.5 Hz; it estimates why there is one. A part
of the model's tip, a part of its velocity and a constant explain the tip that is measured (least squares with
forgetting, three numbers a direction), and the path is led by the inverse of that: the first two are the gain
and the delay that another payload or frequency gives, the constant is the place.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Final

import numpy as np
from scipy.linalg import expm
from scipy.signal import cont2discrete, lfilter

from contid.kinematics.array import Array
from studies.moving.recordings import MOTORS, PERIOD_S, columns, smooth, table

DELAY_S: Final = 0.22
DELAY: Final = round(DELAY_S / PERIOD_S)
#: Limits of the motors [deg, deg/s, deg/s^2]: the robot's own; spools of 30 mm at 100 mm/s and 1000 mm/s^2.
LIMIT_DEG: Final = np.array([50.0, 80.0, 30.0, 80.0, 30.0, 50.0])
SPEED: Final = 191.0
ACCELERATION: Final = 1910.0
RIDGE: Final = 1e-3
LAGS_S: Final = (0.02, 0.05, 0.08, 0.12)
FREQUENCIES_HZ: Final = (2.2, 2.4, 2.6, 2.8)
RATIO: Final = 0.29
#: Rows that the fit of the twin takes, and those it is judged by: the last 35 % of 150 s, 7.5 s later.
FITTED: Final = 0.6
KEPT: Final = 0.65
#: Noise of the tracker [mm], and memory of the feedback [s].
NOISE_MM: Final = 0.3
MEMORY_S: Final = 3.0
PLANE: Final = (0, 2)  # x and z of the cameras; y is up


def terms(angles: Array) -> Array:
    """Monomials up to third degree of motors ``(n, 6)`` [deg], without the constant."""
    x = angles / LIMIT_DEG
    return np.column_stack(
        [x[:, list(c)].prod(axis=1) for d in (1, 2, 3) for c in combinations_with_replacement(range(6), d)]
    )


@dataclass(frozen=True)
class Mode:
    """Lag and mode: from the statics' tip to the tip."""

    lag_s: float
    hz: float
    ratio: float = RATIO

    def filtered(self, values: Array) -> Array:
        """After values held for a tick, from rest at 0."""
        rate = 2.0 * math.pi * self.hz
        parts = np.polymul([self.lag_s, 1.0], [rate**-2, 2.0 * self.ratio / rate, 1.0])
        above, below, _ = cont2discrete(([1.0], parts), PERIOD_S)
        return np.asarray(lfilter(above.ravel(), below, values, axis=0))

    def step(self) -> tuple[Array, Array]:
        """A and b of a tick of the states lag, place, velocity."""
        rate = 2.0 * math.pi * self.hz
        system = np.zeros((4, 4))
        system[0, [0, 3]] = -1.0 / self.lag_s, 1.0 / self.lag_s
        system[1, 2] = 1.0
        system[2, :3] = rate**2, -(rate**2), -2.0 * self.ratio * rate
        whole = expm(system * PERIOD_S)
        return whole[:3, :3], whole[:3, 3]


@dataclass(frozen=True)
class Trunk:
    """Statics and mode. ``weights`` ``(terms, 3)`` [mm], the tip moves from ``rest_mm``."""

    weights: Array
    mode: Mode
    rmse_mm: float

    def still(self, angles: Array) -> Array:
        """The tip ``(n, 2)`` in the plane at rest [mm], from the straight one."""
        return np.asarray(terms(angles) @ self.weights[:, PLANE])


def fitted(grams: int, mode: Mode | None = None) -> Trunk:
    """The twin of a payload; with the best lag and frequency of a grid where no mode is given."""
    of = table(f"trunk-dynamic/random_a_{grams}g.csv.gz")
    sent, tip = columns(of, [f"u{k}_deg" for k in MOTORS]), smooth(columns(of, ["x3_mm", "y3_mm", "z3_mm"]))
    late = np.vstack((np.repeat(sent[:1], DELAY, axis=0), sent[:-DELAY]))
    raw, count = terms(late), len(tip)
    first, second = slice(500, round(FITTED * count), 3), slice(round(KEPT * count), count, 3)
    best: Trunk | None = None
    for each in [mode] if mode else [Mode(lag, hz) for lag in LAGS_S for hz in FREQUENCIES_HZ]:
        x = each.filtered(raw)
        x = np.column_stack((x, np.ones(count)))
        scale = x[first].std(axis=0) + 1e-9
        scale[-1] = 1.0
        a = x[first] / scale
        weights = np.linalg.solve(a.T @ a + RIDGE * len(a) * np.eye(a.shape[1]), a.T @ tip[first])
        left = tip[second] - x[second] / scale @ weights
        rmse = float(np.sqrt(np.mean(np.sum(left**2, axis=1))))
        if best is None or rmse < best.rmse_mm:
            best = Trunk(weights[:-1] / scale[:-1, None], each, rmse)
    assert best is not None
    return best


class Motors:
    """Angles for places in the plane, within the limits of position, speed and acceleration."""

    def __init__(self, model: Trunk, angles: Array) -> None:
        self._model, self.angles, self._speed = model, angles, np.zeros(6)
        self.worst = 0.0

    def towards(self, place_mm: Array) -> Array:
        """One tick: a Newton step to the place with the least angles, held within the limits."""
        return self.move(self.wished(place_mm))

    def wished(self, place_mm: Array, steps: int = 1) -> Array:
        """Angles of least size that bring the tip at rest to a place."""
        angles = self.angles.copy()
        for _ in range(steps):
            rows = np.vstack((angles, angles + np.eye(6)))
            tips = self._model.still(rows)
            slope = (tips[1:] - tips[0]).T * LIMIT_DEG
            change = np.linalg.solve(
                slope @ slope.T + 1e-6 * np.eye(2), place_mm - tips[0] + slope @ (angles / LIMIT_DEG)
            )
            angles = np.clip(LIMIT_DEG * (slope.T @ change), -LIMIT_DEG, LIMIT_DEG)
        return angles

    def move(self, wished: Array) -> Array:
        """Angles of the next tick: as near as speed and acceleration let, never beyond a stop's way."""
        left = wished - self.angles
        # The speed from which it can still stop at what is wished for.
        stop = np.sqrt(2.0 * ACCELERATION * np.abs(left)) * np.sign(left)
        speed = np.where(np.abs(left) < 0.5 * ACCELERATION * PERIOD_S**2, left / PERIOD_S, stop)
        speed = np.where(np.abs(left / PERIOD_S) < np.abs(speed), left / PERIOD_S, speed)
        change = ACCELERATION * PERIOD_S
        speed = np.clip(np.clip(speed, self._speed - change, self._speed + change), -SPEED, SPEED)
        bounded = np.clip(self.angles + speed * PERIOD_S, -LIMIT_DEG, LIMIT_DEG)
        self._speed = (bounded - self.angles) / PERIOD_S
        self.angles = bounded
        return bounded


class Feedback:
    """Part of the model's tip, of its velocity, and a constant that explain what is measured."""

    def __init__(self) -> None:
        self.theta = np.tile(np.array([1.0, 0.0, 0.0]), (2, 1))
        self._p = np.tile(np.diag([0.05, 0.002, 50.0]), (2, 1, 1))
        self._keeps = 1.0 - PERIOD_S / MEMORY_S

    def measured(self, tip: Array, model: Array, velocity: Array) -> None:
        """A measurement, and what the model has for it [mm, mm/s]."""
        for k in range(2):
            x = np.array([model[k], velocity[k], 1.0])
            gain = self._p[k] @ x / (self._keeps * 4.0 + x @ self._p[k] @ x)
            self.theta[k] += gain * (tip[k] - x @ self.theta[k])
            self._p[k] = (self._p[k] - np.outer(gain, x @ self._p[k])) / self._keeps
            # Without motion nothing is learnt; the memory does not grow without bound.
            self._p[k] *= min(1.0, 60.0 / float(np.trace(self._p[k])))

    def asked(self, place: Array, velocity: Array) -> Array:
        """The path of the model for a path of the tip: the inverse of what was found, to first order."""
        a, b, c = self.theta.T
        a = np.clip(a, 0.5, 1.5)
        return np.asarray((place - c) / a - b / a**2 * velocity)


@dataclass(frozen=True)
class Run:
    """Tips ``(ticks, 2)`` [mm], angles ``(ticks, 6)`` and processor time of every tick [s]."""

    tips: Array
    angles: Array
    costs: Array


def follow(
    twin: Trunk, model: Trunk, path: Array, lead: bool, feedback: bool, seed: int = 1
) -> Run:
    """Drive a twin along a path ``(ticks, 2)`` [mm] that is known ahead by the dead time and more.

    Args:
        twin: moves.
        model: commands.
        path: of the tip.
        lead: make up for the dead time, lag and mode.
        feedback: also for what is found in the measured tips.
        seed: of the noise.
    """
    rng = np.random.default_rng(seed)
    motors, found = Motors(model, np.zeros(6)), Feedback()
    a, b = twin.mode.step()
    am, bm = model.mode.step()
    x, xm = np.zeros((3, 2)), np.zeros((3, 2))
    rate, z, lag = 2.0 * math.pi * model.mode.hz, model.mode.ratio, model.mode.lag_s
    first, second = lag + 2.0 * z / rate, lag * 2.0 * z / rate + rate**-2
    d1 = np.gradient(path, PERIOD_S, axis=0)
    d2 = np.gradient(d1, PERIOD_S, axis=0)
    d3 = np.gradient(d2, PERIOD_S, axis=0)
    queue = [np.zeros(6)] * DELAY
    tips, angles, costs = [], [], []
    for k in range(len(path)):
        at = min(k + DELAY, len(path) - 1)
        begun = time.process_time()
        # The model's place lags the command by what the twin's does: its answer is compared with now's tip.
        if feedback:
            found.measured(x[1] + rng.normal(0.0, NOISE_MM, 2), xm[1], xm[2])
        if lead:
            wished = path[at] + first * d1[at] + second * d2[at] + lag * rate**-2 * d3[at]
            change = d1[at] + first * d2[at] + second * d3[at]
            if feedback:
                wished = found.asked(wished, change)
            sent = motors.towards(wished)
        else:
            sent = motors.towards(path[k])
        queue.append(sent)
        late = queue.pop(0)[None, :]
        xm = am @ xm + np.outer(bm, model.still(late)[0])
        costs.append(time.process_time() - begun)
        x = a @ x + np.outer(b, twin.still(late)[0])
        tips.append(x[1])
        angles.append(sent)
    return Run(np.array(tips), np.array(angles), np.array(costs))


def eight(laps: int, width_mm: float = 80.0, hz: float = 0.5) -> Array:
    """A figure of eight that sets out within a second."""
    t = np.arange(0.0, laps / hz, PERIOD_S)
    s = np.clip(t, 0.0, 1.0)
    ease = s**4 * (35.0 - 84.0 * s + 70.0 * s**2 - 20.0 * s**3)
    turn = 2.0 * np.pi * hz * t
    return np.asarray(0.5 * width_mm * ease[:, None] * np.column_stack((np.sin(turn), 0.5 * np.sin(2 * turn))))


def violations(angles: Array) -> int:
    """Ticks beyond a limit of position, speed or acceleration."""
    speed = np.diff(angles, axis=0) / PERIOD_S
    turn = np.diff(speed, axis=0) / PERIOD_S
    bad = (np.abs(angles) > LIMIT_DEG + 1e-9).sum()
    return int(bad + (np.abs(speed) > SPEED + 1e-6).sum() + (np.abs(turn) > ACCELERATION + 1e-4).sum())


@dataclass(frozen=True)
class Jump:
    """Times since the tip began to move, without the dead time [s], overshoot as a share of the way."""

    within_s: float
    overshoot: float
    violations: int


def jump(twin: Trunk, model: Trunk, impulses: tuple[tuple[float, float], ...], way_mm: float = 100.0) -> Jump:
    """A jump along x about the middle, as fast as the motors, in parts as `impulses` state (time [s], share)."""
    begin, end = np.array([-0.5 * way_mm, 0.0]), np.array([0.5 * way_mm, 0.0])
    motors = Motors(model, np.zeros(6))
    motors.angles = motors.wished(begin, 12)
    to = Motors(model, motors.angles.copy())
    goal = to.wished(end, 12)
    plan = np.array([motors.angles.copy(), *[motors.move(goal) for _ in range(300)]])
    sent = np.zeros_like(plan)
    for after_s, share in impulses:
        ticks = after_s / PERIOD_S
        low = math.floor(ticks)
        for at, part in ((low, 1.0 - ticks + low), (low + 1, ticks - low)):
            sent += share * part * np.vstack((np.repeat(plan[:1], at, axis=0), plan[: len(plan) - at]))
    a, b = twin.mode.step()
    still = twin.still(sent)
    x = np.vstack((still[:1], still[:1], np.zeros((1, 2))))
    tips = []
    for row in still:
        x = a @ x + np.outer(b, row)
        tips.append(x[1])
    tip = np.array(tips)
    along = (still[-1] - still[0]) / np.linalg.norm(still[-1] - still[0])
    way = float(np.linalg.norm(still[-1] - still[0]))
    # Arrival is judged about the place where this twin comes to rest.
    off = np.linalg.norm(tip - still[-1], axis=1)
    outside = np.flatnonzero(off > 5.0)
    moved = int(np.argmax(np.linalg.norm(tip - still[0], axis=1) > 1.0))
    over = float((((tip - still[0]) @ along).max() - way) / way)
    return Jump((outside[-1] + 1 - moved) * PERIOD_S, max(0.0, over), violations(sent))


def zv(model: Trunk, kinds: int) -> tuple[tuple[float, float], ...]:
    """Shares of ZV (1) and ZVD (2), see `contid.control.tick.shaping`; 0 for no shaping."""
    root = math.sqrt(1.0 - model.mode.ratio**2)
    k, half = math.exp(-model.mode.ratio * math.pi / root), 0.5 / (model.mode.hz * root)
    sizes = ((1.0,), (1.0, k), (1.0, 2.0 * k, k * k))[kinds]
    return tuple((n * half, size / sum(sizes)) for n, size in enumerate(sizes))


def report() -> Iterator[str]:
    """All tables."""
    model = fitted(0)
    yield f"model: lag {model.mode.lag_s:g} s, {model.mode.hz:g} Hz; kept out {model.rmse_mm:.1f} mm rmse"
    loads = {0: model, **{grams: fitted(grams, model.mode) for grams in (100, 300)}}
    for grams, load in loads.items():
        yield f"twin of {grams} g: kept out {load.rmse_mm:.1f} mm rmse"
    twins = {
        (grams, share): Trunk(load.weights, Mode(model.mode.lag_s, share * model.mode.hz), load.rmse_mm)
        for grams, load in loads.items()
        for share in (0.8, 1.0, 1.2)
    }
    for kinds, name in enumerate(("none", "zv", "zvd")):
        for (grams, share), twin in twins.items():
            found = jump(twin, model, zv(model, kinds))
            yield (
                f"jump, {name}, {grams} g, {share:g} f: within 5 mm after {found.within_s:.2f} s, overshoot "
                f"{100 * found.overshoot:.1f} %, {found.violations} violations"
            )
    path = eight(6)
    for name, lead, feedback in (("commands", False, False), ("led", True, False), ("feedback", True, True)):
        for (grams, share), twin in twins.items():
            run = follow(twin, model, path, lead, feedback)
            off = np.sqrt(np.mean(np.sum((run.tips - path) ** 2, axis=1).reshape(6, -1), axis=1))
            yield (
                f"eight, {name}, {grams} g, {share:g} f: rms by lap "
                f"{', '.join(f'{each:.1f}' for each in off)} mm; {violations(run.angles)} violations; tick "
                f"{1e3 * np.median(run.costs):.2f} ms, p99 {1e3 * np.percentile(run.costs, 99):.2f}"
            )


if __name__ == "__main__":
    for line in report():
        print(line, flush=True)  # noqa: T201
