"""Kinds of motions that show how a robot moves, as rows of coordinates between -1 and 1.

Every motion begins and ends at 0. Its random numbers are drawn once, so that it stays the same where it
becomes slower.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final, TypeAlias

import numpy as np

from contid.kinematics.array import Array

#: Rows per second.
ROWS_HZ: Final = 50.0
#: Rest at both ends of a motion, and behind each move of a ring-down [s].
_REST_S: Final = 0.5
_RINGS_S: Final = 3.0
#: Lines of the sum of sines.
_LINES: Final = 24

#: From how much slower than at first to rows; motions of `KEEP_FREQUENCIES` stay as fast.
Motion: TypeAlias = Callable[[float], Array]


def _smooth(share: Array) -> Array:
    """From 0 to 1 with the least jerk (Flash and Hogan 1985)."""
    s = np.clip(share, 0.0, 1.0)
    return np.asarray(s**3 * (10.0 - 15.0 * s + 6.0 * s * s))


def _through(since_s: Array, poses: Sequence[Array], moves_s: float) -> Array:
    """Rows that stand at 0, then at poses; from each of the times on they go to one within ``moves_s``."""
    times_s = _REST_S + since_s
    at_s = np.arange(math.ceil((times_s[-1] + moves_s + _REST_S) * ROWS_HZ)) / ROWS_HZ
    rows = np.zeros((len(at_s), len(poses[0])))
    before = np.zeros(len(poses[0]))
    for start_s, pose in zip(times_s, poses, strict=True):
        rows += _smooth((at_s - start_s) / moves_s)[:, None] * (pose - before)
        before = pose
    return rows


def _steps(count: int, part_s: float, upper_hz: float, rng: np.random.Generator) -> Motion:
    """Every coordinate alone to one side and back, in random order, then several together at random."""
    each_s = 0.5 / upper_hz
    holds_s = max(part_s / (3.0 * count), 0.4) * rng.uniform(0.6, 1.4, 3 * count)
    alone = rng.permutation(np.eye(count)) * rng.choice([-1.0, 1.0], count)[:, None]
    together = rng.uniform(-0.7, 0.7, (count, count))
    middle = np.zeros(count)
    poses = [*(pose for away in alone for pose in (away, middle)), *together, middle]

    def motion(slowed: float) -> Array:
        moves_s = each_s * slowed
        return _through(np.append(0.0, np.cumsum(moves_s + holds_s)), poses, moves_s)

    return motion


def _sines(count: int, part_s: float, upper_hz: float, rng: np.random.Generator) -> Motion:
    """Sums of sines; each coordinate has lines of its own, so that their answers can be separated."""
    at_s = np.arange(math.ceil(part_s * ROWS_HZ)) / ROWS_HZ
    lines = np.geomspace(min(max(2.0 / part_s, 0.05 * upper_hz), upper_hz), upper_hz, max(_LINES, 3 * count))
    phases = rng.uniform(0.0, 2.0 * math.pi, len(lines))
    # Smaller at higher frequencies: the speed is about the same in each.
    waves = np.sin(2.0 * math.pi * lines * at_s[:, None] + phases) / lines
    sums = np.column_stack([waves[:, k::count].sum(axis=1) for k in range(count)])
    return lambda slowed: sums / np.abs(sums).max(axis=0) * _ends(at_s)[:, None]


def _chirp(count: int, part_s: float, upper_hz: float, rng: np.random.Generator) -> Motion:
    """One coordinate after the other from slow to fast, at about the same speed."""
    each_s = part_s / count
    at_s = np.arange(math.ceil(each_s * ROWS_HZ)) / ROWS_HZ
    low_hz = min(max(1.0 / each_s, 0.1 * upper_hz), upper_hz)
    rate = math.log(upper_hz / low_hz) / each_s if upper_hz > low_hz else 1e-9
    phase = 2.0 * math.pi * low_hz * np.expm1(rate * at_s) / rate
    wave = np.sin(phase) * np.exp(-rate * at_s) * _ends(at_s)
    rows = np.zeros((count * len(at_s), count))
    for place, k in enumerate(rng.permutation(count)):
        rows[place * len(at_s) : (place + 1) * len(at_s), k] = wave
    return lambda slowed: rows


def _ring_downs(count: int, part_s: float, upper_hz: float, rng: np.random.Generator) -> Motion:
    """Away, then back as fast as is allowed, and rest until the swing has died out."""
    moves = max(int(part_s / (2.0 * _RINGS_S)), 1)
    middle = np.zeros(count)
    away = np.eye(count)[np.resize(rng.permutation(count), moves)]
    poses = [*(pose for each in away for pose in (each, middle)), middle]

    def motion(slowed: float) -> Array:
        moves_s = 0.1 * slowed
        return _through(np.arange(float(len(poses))) * (moves_s + _RINGS_S), poses, moves_s)

    return motion


def _ends(at_s: Array) -> Array:
    """1 with smooth ends."""
    ramp_s = min(1.0, 0.2 * float(at_s[-1]))
    return np.asarray(_smooth(at_s / ramp_s) * _smooth((at_s[-1] - at_s) / ramp_s))


#: Kind -> its motion for a count of coordinates, a duration, the highest frequency, and random numbers.
KINDS: Final[dict[str, Callable[[int, float, float, np.random.Generator], Motion]]] = {
    "steps": _steps,
    "sines": _sines,
    "chirp": _chirp,
    "ring-downs": _ring_downs,
}
#: Kinds that become smaller where they are too fast, not slower.
KEEP_FREQUENCIES: Final = ("sines", "chirp")
