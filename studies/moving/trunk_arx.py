"""The baseline of `trunk_predictive`: predictive control by a linear ARX model of commands and measured tips.

Fitted to the recording with 0 g, at 50 ms; the same solver, box constraints on the angles and on their steps.
"""

from __future__ import annotations

import time
from typing import Final

import numpy as np

from contid.kinematics.array import Array
from studies.moving.recordings import PERIOD_S, columns, smooth, table
from studies.moving.trunk_control import NOISE_MM
from studies.moving.trunk_program import PredictiveRun, Program
from studies.moving.trunk_twin import LIMIT_DEG, PLANE, SPEED, Motors, MovingTrunk

ARX_ORDER: Final = 6
ARX_PAST: Final = 12
ARX_TICKS: Final = 5
ARX_HORIZON: Final = 16
#: Weight of a step of the motors [mm^2/deg^2], best of 1, 10, 30, 100 and 1000: with 1 it does not settle.
ARX_STEP: Final = 30.0
#: Iterations at most: it has 50 ms, not a tick.
ARX_ITERATIONS: Final = 60


class ArxPredictive:
    """Predictive control by a linear ARX model of commands and measured tips."""

    def __init__(self, motors: Motors) -> None:
        of = table("trunk-dynamic/random_a_0g.csv.gz")
        sent = columns(of, [f"u{k}_deg" for k in range(1, 7)])[::ARX_TICKS]
        tip = smooth(columns(of, ["x3_mm", "y3_mm", "z3_mm"]))[::ARX_TICKS, PLANE]
        self._middle = tip.mean(axis=0)
        y, first = tip - self._middle, ARX_PAST
        x = np.array([self._row(y[:k], sent[:k]) for k in range(first, len(y))])
        normal = x.T @ x + 1e-3 * len(x) * np.eye(x.shape[1])
        self._weights = np.linalg.solve(normal, x.T @ y[first:])
        self.motors = motors
        change = np.zeros((ARX_HORIZON, 2, ARX_HORIZON // 2, 6))
        zero_y, zero_u = np.zeros((ARX_PAST, 2)), np.zeros((ARX_PAST, 6))
        for knot in range(ARX_HORIZON // 2):
            for motor in range(6):
                later = np.zeros((ARX_HORIZON, 6))
                later[2 * knot : 2 * knot + 2, motor] = 1.0
                change[:, :, knot, motor] = self._rolled(zero_y, zero_u, later)
        self._answers = change.reshape(2 * ARX_HORIZON, -1)
        count = ARX_HORIZON // 2
        steps = np.kron(np.eye(count) - np.eye(count, k=-1), np.eye(6))
        self._rows = np.vstack((np.eye(6 * count), steps))
        self.program = Program(
            self._answers.T @ self._answers + ARX_STEP * steps.T @ steps + 1e-3 * np.eye(6 * count)
        )
        self.program.limit(ARX_ITERATIONS)
        self._count, self._steps = count, steps
        self.past_y, self.past_u = zero_y, zero_u

    @staticmethod
    def _row(y: Array, u: Array) -> Array:
        return np.concatenate((y[: -ARX_ORDER - 1 : -1].ravel(), u[: -ARX_PAST - 1 : -1].ravel()))

    def _rolled(self, past_y: Array, past_u: Array, later: Array) -> Array:
        y, u = list(past_y), list(past_u)
        for row in later:
            u.append(row)
            y.append(self._row(np.array(y[-ARX_PAST:]), np.array(u[-ARX_PAST:])) @ self._weights)
        return np.array(y[len(past_y) :])

    def command(self, tip: Array, wished: Array) -> None:
        """Plan anew from a measured tip; ``wished`` ``(ARX_HORIZON, 2)`` from one step later on [mm]."""
        self.past_y = np.vstack((self.past_y[1:], tip))
        free = self._rolled(self.past_y, self.past_u, np.zeros((ARX_HORIZON, 6)))
        now = np.zeros(6 * self._count)
        now[:6] = self.past_u[-1]
        most = np.full(len(now), SPEED * ARX_TICKS * PERIOD_S)
        linear = self._answers.T @ (free - wished).ravel() - ARX_STEP * self._steps.T @ now
        box = np.tile(LIMIT_DEG, self._count)
        found = self.program.solved(
            linear, self._rows, np.concatenate((-box, now - most)), np.concatenate((box, now + most))
        )
        self.past_u = np.vstack((self.past_u[1:], self.past_u[-1] if found is None else found[:6]))


def steered_by_arx(twin: MovingTrunk, model: MovingTrunk, path: Array, begin: Array) -> PredictiveRun:
    """The same by linear ARX; the dead time of the twin is that of the recording, which it was fitted to."""
    rng = np.random.default_rng(1)
    motors = Motors(model, begin)
    control = ArxPredictive(motors)
    a, b = twin.mode.step()
    x = np.vstack((twin.still(begin[None, :]),) * 2 + (np.zeros((1, 2)),))
    control.past_u = np.tile(begin, (ARX_PAST, 1))
    control.past_y = np.tile(x[1], (ARX_PAST, 1))
    ahead = np.vstack((path, np.repeat(path[-1:], ARX_TICKS * (ARX_HORIZON + 1), axis=0)))
    queue = [begin] * model.delay
    tips, angles, costs = [], [], []
    for k in range(len(path)):
        begun = time.process_time()
        if k % ARX_TICKS == 0:
            own = ahead[k + ARX_TICKS :: ARX_TICKS][:ARX_HORIZON]
            control.command(x[1] + rng.normal(0.0, NOISE_MM, 2), own)
        share = (k % ARX_TICKS + 1) / ARX_TICKS
        before, after = control.past_u[-2:]
        sent = motors.follow(before + share * (after - before))
        costs.append(time.process_time() - begun)
        queue.append(sent)
        x = a @ x + np.outer(b, twin.still(queue.pop(0)[None, :])[0])
        tips.append(x[1])
        angles.append(sent)
    return PredictiveRun(
        np.array(tips), np.array(angles), np.array(costs), 0, np.array(control.program.costs)
    )
