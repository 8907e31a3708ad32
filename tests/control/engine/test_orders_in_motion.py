"""Orders to a robot that accelerates: velocity, acceleration and jerk of its file hold in every tick."""

from __future__ import annotations

import math

import numpy as np
import pytest

from contid.control.engine.messages import Goto, Hold, Stop
from contid.control.tick.supervisor import Mode
from contid.robot_file.base import StopPolicy
from contid.targets import Target, Vec3
from tests.control.engine.streamed import Followed, Run, middle

#: Times into a fast line to and fro at which the order comes: about a turning point, and in the middle.
TIMES_S = (1.2, *(pytest.param(time_s, marks=pytest.mark.campaign) for time_s in (1.9, 2.0, 2.15)))
ROBOTS = ("finger", "trirack", "stiffflop1")


def moving(name: str, seconds: float) -> tuple[Run, list[np.ndarray]]:
    """A robot on a live stream, and its commands."""
    run = Run(name)
    x, y, z = middle(run)

    def at(time_s: float) -> Vec3:
        return x + 0.004 * (1.0 - math.cos(2.0 * math.pi * time_s / 0.8)), y, z

    run.at_rest_on(at(0.0))
    return run, list(run.follow([(k / 100.0, at(k / 100.0)) for k in range(300)], seconds).axes)


def goes_on(run: Run, axes: list[np.ndarray], seconds: float) -> None:
    """Tick, and add the commands."""
    for _ in range(round(seconds / run.config.period_s)):
        run.tick()
        if run.mode is Mode.OFF:
            break
        axes.append(np.array(run.engine.robots.states[0].command))


def holds_its_limits(run: Run, axes: list[np.ndarray]) -> bool:
    shares = run.rates(Followed(np.array([]), np.array(axes), np.array([]), np.array([])))
    return max(shares) <= 1.0 + 1e-6


@pytest.mark.parametrize("seconds", TIMES_S)
@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("order", [Hold(), Stop(policy=StopPolicy.HOLD), Stop(policy=StopPolicy.REST)])
def test_a_stop_begins_with_the_present_acceleration(name: str, order: Hold | Stop, seconds: float) -> None:
    run, axes = moving(name, seconds)
    run.engine.obey(order, run.process.tick)
    goes_on(run, axes, 0.6)
    assert holds_its_limits(run, axes)


@pytest.mark.parametrize("seconds", TIMES_S)
@pytest.mark.parametrize("name", ROBOTS)
def test_a_goto_begins_with_the_acceleration_of_the_stop_before_it(name: str, seconds: float) -> None:
    run, axes = moving(name, seconds)
    run.engine.obey(Hold(), run.process.tick)
    goes_on(run, axes, 3 * run.config.period_s)
    goal = Target(tip_m=run.config.frame.point_in_world(middle(run)))
    run.engine.obey(Goto(run.config.name, goal), run.process.tick)
    goes_on(run, axes, 0.6)
    assert holds_its_limits(run, axes)
    assert run.mode is Mode.HOLD
    assert math.dist(run.config.model.forward(tuple(axes[-1])).tip_m, middle(run)) < 1e-4
