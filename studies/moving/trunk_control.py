"""Jumps and figures of eight of a real trunk's twin: commands alone, led, and led with feedback.

    python -m studies.moving.trunk_control

A twin for each payload (`studies.moving.trunk_twin`); its frequency is 0.8, 1 or 1.2 times what was fitted.
What commands it has the model of 0 g and the fitted frequency.

Feedback with a dead time of 0.22 s cannot wait for an error at 0.5 Hz; it estimates why there is one. A part
of the model's tip, a part of its velocity and a constant explain the tip that is measured (least squares with
forgetting, three numbers a direction), and the path is led by the inverse of that: the first two are the gain
and the delay that another payload or frequency gives, the constant is the place.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from contid.kinematics.array import Array
from studies.moving.recordings import PERIOD_S
from studies.moving.trunk_twin import DELAY, Motors, MovingTrunk, TrunkMode, fitted, violations

#: Noise of the tracker [mm], and memory of the feedback [s].
NOISE_MM: Final = 0.3
MEMORY_S: Final = 3.0
LAPS: Final = 3
#: The shaper "zv, low" is for this share of the frequency: too low a one leaves less than too high a one.
LOW: Final = 0.9


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
class TrunkRun:
    """Tips ``(ticks, 2)`` [mm], angles ``(ticks, 6)`` and processor time of every tick [s]."""

    tips: Array
    angles: Array
    costs: Array


def follow(
    twin: MovingTrunk, model: MovingTrunk, path: Array, lead: bool, feedback: bool, seed: int = 1
) -> TrunkRun:
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
    return TrunkRun(np.array(tips), np.array(angles), np.array(costs))


def eight(laps: int, width_mm: float = 80.0, hz: float = 0.5) -> Array:
    """A figure of eight that sets out within a second."""
    t = np.arange(0.0, laps / hz, PERIOD_S)
    s = np.clip(t, 0.0, 1.0)
    ease = s**4 * (35.0 - 84.0 * s + 70.0 * s**2 - 20.0 * s**3)
    turn = 2.0 * np.pi * hz * t
    return np.asarray(
        0.5 * width_mm * ease[:, None] * np.column_stack((np.sin(turn), 0.5 * np.sin(2 * turn)))
    )


@dataclass(frozen=True)
class Jump:
    """Times since the tip began to move, without the dead time [s], overshoot as a share of the way."""

    within_s: float
    overshoot: float
    violations: int


def jump(
    twin: MovingTrunk, model: MovingTrunk, parts: tuple[tuple[float, float], ...], way_mm: float = 100.0
) -> Jump:
    """A jump along x about the middle, as fast as the motors, in parts (time [s], share)."""
    begin, end = np.array([-0.5 * way_mm, 0.0]), np.array([0.5 * way_mm, 0.0])
    motors = Motors(model, np.zeros(6))
    motors.angles = motors.wished(begin, 12)
    to = Motors(model, motors.angles.copy())
    goal = to.wished(end, 12)
    plan = np.array([motors.angles.copy(), *[motors.move(goal) for _ in range(300)]])
    sent = np.zeros_like(plan)
    for after_s, share in parts:
        ticks = after_s / PERIOD_S
        low = math.floor(ticks)
        for at, near in ((low, 1.0 - ticks + low), (low + 1, ticks - low)):
            sent += share * near * np.vstack((np.repeat(plan[:1], at, axis=0), plan[: len(plan) - at]))
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


def impulses(model: MovingTrunk, kind: str) -> tuple[tuple[float, float], ...]:
    """Times [s] and shares of a shaper, see `contid.control.tick.shaping`."""
    root = math.sqrt(1.0 - model.mode.ratio**2)
    k, half = math.exp(-model.mode.ratio * math.pi / root), 0.5 / (model.mode.hz * root)
    sizes = {"none": (1.0,), "zvd": (1.0, 2.0 * k, k * k)}.get(kind, (1.0, k))
    if kind == "zv, low":
        half /= LOW
    return tuple((n * half, size / sum(sizes)) for n, size in enumerate(sizes))


def report() -> Iterator[str]:
    """All tables."""
    model = fitted(0)
    mode = model.mode
    yield f"model: dead time {model.delay} ticks, lag {mode.lag_s:g} s, {mode.hz:g} Hz"
    loads = {0: model, **{grams: fitted(grams, (model.delay,), (mode,)) for grams in (100, 300)}}
    for grams, load in loads.items():
        yield f"twin of {grams} g: kept out {load.rmse_mm:.1f} mm"
    twins = {
        (grams, share): replace(load, mode=TrunkMode(mode.lag_s, share * mode.hz))
        for grams, load in loads.items()
        for share in (0.8, 1.0, 1.2)
    }
    for name in ("none", "zv", "zv, low", "zvd"):
        for (grams, share), twin in twins.items():
            found = jump(twin, model, impulses(model, name))
            yield (
                f"jump, {name}, {grams} g, {share:g} f: within 5 mm after {found.within_s:.2f} s, overshoot "
                f"{100 * found.overshoot:.1f} %, {found.violations} violations"
            )
    path = eight(LAPS)
    for (grams, share), twin in twins.items():
        for name, run in (
            ("commands", follow(twin, model, path, lead=False, feedback=False)),
            ("led", follow(twin, model, path, lead=True, feedback=False)),
            ("feedback", follow(twin, model, path, lead=True, feedback=True)),
        ):
            off = np.sqrt(np.mean(np.sum((run.tips - path) ** 2, axis=1).reshape(LAPS, -1), axis=1))
            yield (
                f"eight, {name}, {grams} g, {share:g} f: rms by lap "
                f"{', '.join(f'{each:.1f}' for each in off)} mm; {violations(run.angles)} violations; "
                f"{1e3 * np.median(run.costs):.2f} ms, p99 {1e3 * np.percentile(run.costs, 99):.2f}"
            )


if __name__ == "__main__":
    for line in report():
        print(line, flush=True)  # noqa: T201
