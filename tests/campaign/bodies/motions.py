"""Random motions within the rates of a robot, as its limiters let them through."""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Iterator

from contid.control.tick.config import RobotConfig
from tests.campaign.bodies.plants import RATE_HZ


def motion(config: RobotConfig, draw: random.Random) -> Iterator[tuple[float, ...]]:
    """Random commands [m, Pa or rad] within the rates: rounded trapezoids at any speed, and standstills."""

    def one(axis: int) -> Iterator[float]:
        limit = config.limits[axis]
        at = draw.uniform(limit.lower, limit.upper)
        while True:
            goal = draw.uniform(limit.lower, limit.upper)
            if draw.random() < 0.5:  # a short way
                goal = min(max(at + 0.1 * (goal - at), limit.lower), limit.upper)
            speed = config.velocity[axis] * 10.0 ** draw.uniform(-1.7, 0.0)
            push = config.acceleration[axis]
            way, sign = abs(goal - at), 1.0 if goal > at else -1.0
            ramp = min(speed / push, (way / push) ** 0.5)
            top = push * ramp
            cruise = (way - top * ramp) / top if top > 0.0 else 0.0
            whole = 2.0 * ramp + cruise
            for k in range(1, int(whole * RATE_HZ) + 1):
                t = k / RATE_HZ
                if t < ramp:
                    done = 0.5 * push * t * t
                elif t < ramp + cruise:
                    done = 0.5 * top * ramp + top * (t - ramp)
                else:
                    done = way - 0.5 * push * max(whole - t, 0.0) ** 2
                yield at + sign * done
            at = goal
            for _ in range(int(draw.expovariate(1.0) * RATE_HZ)):
                yield at

    def smooth(axis: int) -> Iterator[float]:
        """The same with limited jerk: the mean of the ticks in which the acceleration may rise."""
        source = one(axis)
        newest: deque[float] = deque([next(source)], maxlen=max(round(rises_s[axis] * RATE_HZ), 1))
        while True:
            yield sum(newest) / len(newest)
            newest.append(next(source))

    rises_s = [push / jerk for push, jerk in zip(config.acceleration, config.jerk, strict=True)]
    axes = [smooth(axis) for axis in range(len(config.axes))]
    while True:
        yield tuple(next(axis) for axis in axes)
