"""Redundant motion under the limits of the axes: the tip stays on its target while the axes catch up."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from contid.control.tick.config import RobotConfig
from contid.control.tick.limits import allowed_steps, limit_axis
from contid.control.tick.next_command import limit_on_path, tip_tolerance_m
from contid.targets import Actuation, Target
from tests.support.robot_configs import SLACK, config_of


def elsewhere(config: RobotConfig, rng: np.random.Generator) -> tuple[Actuation, Actuation, Target]:
    """Two actuations of one tip: a random one and the preferred one."""
    low, high = np.array(config.model.lower), np.array(config.model.upper)
    while True:
        share = rng.uniform(0.3, 0.7) + rng.uniform(-0.02, 0.02, len(low))
        start = tuple((low + share * (high - low)).tolist())
        target = Target(tip_m=config.model.forward(start).tip_m)
        answer = config.model.inverse(target, start)
        if answer.converged and math.dist(answer.actuation, start) > 20 * config.limits[0].change:
            return start, answer.actuation, target


@pytest.mark.parametrize("name", ["trirack2", "stiffflop2"])
def test_axes_travel_to_the_preferred_solution_with_the_tip_at_rest(name: str) -> None:
    config, rng = config_of(name), np.random.default_rng(16)
    for _ in range(10):
        command, answer, target = elsewhere(config, rng)
        steps = before = (0.0,) * len(command)
        assert target.tip_m is not None
        commands, bound = [command], 0
        for _ in range(2000):
            after, flags, _ = limit_on_path(config, command, steps, answer, before, target)
            assert math.dist(config.model.forward(after).tip_m, target.tip_m) <= tip_tolerance_m(
                config.quantity
            )
            bound += any(flags)
            steps = tuple(new - old for new, old in zip(after, command, strict=True))
            command = after
            commands.append(after)
            if after == answer and not any(steps):
                break
        assert bound
        assert command == answer
        path = np.array(commands)
        moves = np.diff(path, axis=0)
        assert np.abs(moves).max() <= config.limits[0].step * SLACK
        assert np.abs(np.diff(moves, axis=0)).max() <= config.limits[0].change * SLACK


@pytest.mark.parametrize("target", [-1e9, 1e9])
def test_the_allowed_steps_are_those_of_the_limiter(target: float) -> None:
    """The limiter's answer to a target far away is an end of the interval; along a random motion."""
    (each, *_), rng = config_of("trirack2").limits, np.random.default_rng(3)
    positions = [0.3, 0.3]
    for _ in range(3000):
        last, last_step = positions[-1], positions[-1] - positions[-2]
        low, high = allowed_steps(each, last, last_step)
        extreme, _ = limit_axis(each, last, last_step, target, 0.0)
        end = low if target < 0.0 else high
        assert extreme - last == pytest.approx(end, abs=1e-12)
        assert low <= high
        positions.append(min(max(last + rng.choice([low, high]), each.lower), each.upper))
    assert any(abs(b - a) > 0.9 * each.step for a, b in pairwise(positions))
