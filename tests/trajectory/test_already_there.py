"""Motions of next to nothing: ways down to 1e-20, speeds down to 1e-18, alone and beside long ways."""

from __future__ import annotations

import math
import random

import pytest

from contid.trajectory.approach import Approach
from contid.trajectory.standstill import JerkLimitedStop
from contid.trajectory.straight_stop import StraightStop


def tiny(rng: random.Random, low: float, high: float) -> float:
    return rng.choice((-1.0, 1.0)) * math.pow(10.0, rng.uniform(low, high))


def test_the_motion_of_the_report_exists() -> None:
    """`tendon3` at rest, the first jog: 5e-18 of way on one axis."""
    here = 0.000264651
    motion = Approach((here, 0.0), (0.0, 1e-17), (here + 5e-18, 0.0), (0.05,) * 2, (0.5,) * 2, (5.0,) * 2)
    assert motion.duration_s < 1e-6
    assert motion.at(motion.duration_s) == ((here + 5e-18, 0.0), (0.0, 0.0))


@pytest.mark.parametrize("seed", range(4))
def test_motions_of_next_to_nothing_exist_and_stay_between_their_ends(seed: int) -> None:
    rng = random.Random(seed)
    for _ in range(700):
        axes = rng.choice((1, 2, 3, 6, 9))
        if rng.random() < 0.7:
            speed = [rng.choice((0.03, 0.2, 1.0, 3e5))] * axes
        else:
            speed = [rng.uniform(0.01, 2.0) for _ in range(axes)]
        acceleration = [v * rng.uniform(2, 20) for v in speed]
        jerk = [a * rng.uniform(5, 100) for a in acceleration]
        start = [0.0 if rng.random() < 0.3 else rng.uniform(-0.3, 0.3) * v for v in speed]
        way = [
            rng.choice((tiny(rng, -20, -6), tiny(rng, -20, -6), 0.0, rng.uniform(-0.2, 0.2) * v))
            for v in speed
        ]
        goal = [here + by for here, by in zip(start, way, strict=True)]
        straight = rng.random() < 0.3
        velocity = [0.0 if straight or rng.random() < 0.4 else tiny(rng, -18, -9) for _ in speed]
        motion = Approach(start, velocity, goal, speed, acceleration, jerk, straight=straight)
        assert math.isfinite(motion.duration_s)
        assert motion.at(motion.duration_s) == (tuple(goal), (0.0,) * axes)
        for share in (0.0, 0.01, 0.3, 0.5, 0.7, 0.999):
            position, _ = motion.at(share * motion.duration_s)
            for x, a, b, v in zip(position, start, goal, speed, strict=True):
                assert min(a, b) - 5e-6 * v <= x <= max(a, b) + 5e-6 * v


@pytest.mark.parametrize("seed", range(4))
def test_stops_from_next_to_nothing_exist(seed: int) -> None:
    rng = random.Random(seed)
    for _ in range(500):
        axes = rng.choice((1, 3, 9))
        at = tuple(rng.uniform(-0.1, 0.1) for _ in range(axes))
        speeds = [rng.choice((tiny(rng, -18, -9), tiny(rng, -18, -9), 0.0, 0.1)) for _ in at]
        gentle = JerkLimitedStop(at, tuple(speeds), [0.5] * axes, [5.0] * axes)
        end, rest = gentle.at(gentle.duration_s)
        assert not any(rest)
        assert all(abs(b - a) <= abs(v) + 1e-15 for a, b, v in zip(at, end, speeds, strict=True))
        short = StraightStop(at, tuple(v * 0.002 for v in speeds), [2e-6] * axes, [(-1.0, 1.0)] * axes, 0.002)
        end, rest = short.at(short.duration_s)
        assert not any(rest)
        assert all(abs(b - a) <= abs(v) + 1e-15 for a, b, v in zip(at, end, speeds, strict=True))
