"""The twin of a real trunk in motion, fitted to its recordings, and the limits of its motors.

Recordings: ``trunk-dynamic/random_a_*g`` of StanfordASL/trunk-stack (MIT, (c) 2024 Stanford Autonomous
Systems Lab; README of ``../shared/data/moving``). A polynomial of third degree leads from the six motors to
the tip at rest, then follow a dead time, a lag and one mode, the same for all directions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Final

import numpy as np
from scipy.linalg import expm

from contid.kinematics.array import Array
from contid_identify.split import split_time
from studies.moving.recordings import MOTORS, PERIOD_S, columns, smooth, table

#: Dead time of commands in the runs, greater than that of the recordings.
DELAY_S: Final = 0.22
DELAY: Final = round(DELAY_S / PERIOD_S)
#: Limits of the motors [deg, deg/s, deg/s^2]: the robot's own; spools of 30 mm at 100 mm/s and 1000 mm/s^2.
LIMIT_DEG: Final = np.array([50.0, 80.0, 30.0, 80.0, 30.0, 50.0])
SPEED: Final = 191.0
ACCELERATION: Final = 1910.0
RIDGE: Final = 1e-4
DELAYS: Final = (12, 14, 16)
LAGS_S: Final = (0.02, 0.04, 0.06)
FREQUENCIES_HZ: Final = (2.2, 2.4, 2.6)
RATIO: Final = 0.29
#: Every how many rows one is fitted.
STRIDE: Final = 5
PLANE: Final = (0, 2)  # x and z of the cameras; y is up


#: Motors of every monomial; 6 stands for 1.
FACTORS: Final = np.array(
    [(*c, *(6,) * (3 - d)) for d in (1, 2, 3) for c in combinations_with_replacement(range(6), d)]
)


def terms(angles: Array) -> Array:
    """Monomials up to third degree of motors ``(n, 6)`` [deg], without the constant."""
    x = np.column_stack((angles / LIMIT_DEG, np.ones(len(angles))))
    return np.asarray(x[:, FACTORS].prod(axis=2))


@dataclass(frozen=True)
class TrunkMode:
    """Lag and mode: from the statics' tip to the tip."""

    lag_s: float
    hz: float
    ratio: float = RATIO

    def filtered(self, values: Array) -> Array:
        """After values held for a tick, from rest at 0."""
        rate = 2.0 * math.pi * self.hz
        parts = np.polymul([self.lag_s, 1.0], [rate**-2, 2.0 * self.ratio / rate, 1.0])
        from scipy.signal import cont2discrete, lfilter  # a second and more

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


MODES: Final = tuple(TrunkMode(lag_s, hz) for lag_s in LAGS_S for hz in FREQUENCIES_HZ)


@dataclass(frozen=True)
class MovingTrunk:
    """Statics and mode: ``weights`` ``(terms, 3)`` [mm], and the dead time of the recording [ticks]."""

    weights: Array
    mode: TrunkMode
    rmse_mm: float
    delay: int

    def still(self, angles: Array) -> Array:
        """The tip ``(n, 2)`` in the plane at rest [mm], from the straight one."""
        return np.asarray(terms(angles) @ self.weights[:, PLANE])


def fitted(grams: int, delays: tuple[int, ...] = DELAYS, modes: tuple[TrunkMode, ...] = MODES) -> MovingTrunk:
    """The twin of a payload: the best of some dead times [ticks] and modes on the blocks kept out."""
    of = table(f"trunk-dynamic/random_a_{grams}g.csv.gz")
    sent, tip = columns(of, [f"u{k}_deg" for k in MOTORS]), smooth(columns(of, ["x3_mm", "y3_mm", "z3_mm"]))
    split = split_time(PERIOD_S * np.arange(float(len(tip))))
    rows, kept = np.flatnonzero(split.fitted)[100::STRIDE], np.flatnonzero(split.kept_out)[::STRIDE]
    raw = terms(sent)
    best: MovingTrunk | None = None
    for mode in modes:
        whole = mode.filtered(raw)
        for delay in delays:
            x = np.column_stack(
                (np.vstack((np.zeros((delay, raw.shape[1])), whole[:-delay])), np.ones(len(tip)))
            )
            scale = np.append(x[rows, :-1].std(axis=0) + 1e-9, 1.0)
            a = x[rows] / scale
            weights = np.linalg.solve(a.T @ a + RIDGE * len(a) * np.eye(a.shape[1]), a.T @ tip[rows])
            left = tip[kept] - x[kept] / scale @ weights
            rmse = float(np.sqrt(np.mean(np.sum(left**2, axis=1))))
            if best is None or rmse < best.rmse_mm:
                best = MovingTrunk(weights[:-1] / scale[:-1, None], mode, rmse, delay)
    assert best is not None
    return best


class Motors:
    """Angles for places in the plane, within the limits of position, speed and acceleration."""

    def __init__(self, model: MovingTrunk, angles: Array) -> None:
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
        return self._at(_braking(wished - self.angles))

    def follow(self, wished: Array) -> Array:
        """The same without a stop at what is wished for: only the ends of travel are braked for."""
        speed = (wished - self.angles) / PERIOD_S
        ends = (_braking(side * LIMIT_DEG - self.angles) for side in (-1.0, 1.0))
        return self._at(np.clip(speed, *ends))

    def _at(self, speed: Array) -> Array:
        brake = ACCELERATION * PERIOD_S
        speed = np.clip(np.clip(speed, self._speed - brake, self._speed + brake), -SPEED, SPEED)
        bounded = np.clip(self.angles + speed * PERIOD_S, -LIMIT_DEG, LIMIT_DEG)
        self._speed = (bounded - self.angles) / PERIOD_S
        self.angles = bounded
        return bounded


def _braking(left: Array) -> Array:
    """The greatest speeds from which whole ticks of braking end at a way that is left, or before."""
    brake = ACCELERATION * PERIOD_S
    ways = np.abs(left) / (brake * PERIOD_S)
    ticks = np.floor(0.5 * (np.sqrt(1.0 + 8.0 * ways) - 1.0))
    return np.asarray(np.sign(left) * brake * (ways / (ticks + 1.0) + 0.5 * ticks))


def violations(angles: Array) -> int:
    """Ticks beyond a limit of position, speed or acceleration."""
    speed = np.diff(angles, axis=0) / PERIOD_S
    turn = np.diff(speed, axis=0) / PERIOD_S
    bad = (np.abs(angles) > LIMIT_DEG + 1e-9).sum()
    return int(bad + (np.abs(speed) > SPEED + 1e-6).sum() + (np.abs(turn) > ACCELERATION + 1e-4).sum())
