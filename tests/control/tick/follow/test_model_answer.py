"""Rows out of reach on a live stream: what is asked of the model, and how near the robot comes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest

from contid.control.tick.config import MOTION_RULES
from contid.control.tick.follow.model_answer import answered
from contid.targets import Actuation, Solution, Target, Vec3
from tests.control.engine.streamed import Run

#: Robots and the distance of tips that they do not reach [m].
BEYOND_M = {"trirack2": 2.0, "stiffflop2": 0.2, "cbha": 1.0}


@dataclass
class Asked:
    """Counts what a model is asked: for a search, and for what is nearest beside an answer."""

    inverse: int = 0
    follow: int = 0


def counted(run: Run, rules: int) -> Asked:
    """Count the questions to the model of a robot, which follows by these rules from now on."""
    asked, model = Asked(), run.config.model
    inverse, follow = model.inverse, getattr(model, "follow")  # noqa: B009 - of some models

    def count_inverse(target: Target, seed: Actuation) -> Solution:
        asked.inverse += 1
        found: Solution = inverse(target, seed)
        return found

    def count_follow(target: Target, answer: Actuation) -> Solution:
        before, asked.follow = asked.inverse, asked.follow + 1
        found: Solution = follow(target, answer)
        asked.inverse = before  # a model may follow by the same method
        return found

    setattr(model, "inverse", count_inverse)  # noqa: B010 - of this one
    setattr(model, "follow", count_follow)  # noqa: B010 - of this one
    robots = run.engine.robots
    robots.configs = (replace(run.config, motion_rules=rules),)
    run.config = robots.configs[0]
    return asked


def beyond(name: str, angle: float) -> Vec3:
    """A tip in a direction of the plane of x and z, out of reach."""
    return (BEYOND_M[name] * math.sin(angle), 0.0, BEYOND_M[name] * math.cos(angle))


def streamed(run: Run, tips: Sequence[Vec3]) -> list[Actuation]:
    """The commands, one row a tick."""
    commands = []
    for tip in tips:
        run.row(tip)
        run.tick()
        commands.append(run.engine.robots.states[0].command)
    return commands


def started(name: str) -> Run:
    run = Run(name)
    run.at_rest_on(run.config.model.forward(run.config.rest).tip_m)
    return run


@pytest.mark.parametrize("name", ["trirack2", "stiffflop2", pytest.param("cbha", marks=pytest.mark.campaign)])
def test_a_row_out_of_reach_that_stands_is_searched_for_once(name: str) -> None:
    run = started(name)
    asked = counted(run, MOTION_RULES)
    commands = streamed(run, [beyond(name, 0.3)] * 1400)
    assert commands[-1] == commands[-100]
    asked.inverse = asked.follow = 0
    streamed(run, [beyond(name, 0.3)] * 100)
    assert (asked.inverse, asked.follow) == (0, 0)


def test_by_older_rules_the_answer_is_kept_for_the_same_question_only() -> None:
    run = started("trirack2")
    asked = counted(run, 6)
    state, config = run.engine.robots.states[0], run.config
    target = Target(tip_m=beyond("trirack2", 0.3))
    first = answered(config, state, target)
    assert first.solution == config.model.inverse(target, state.command)
    asked.inverse = 0
    after = replace(state, missed=first)
    assert answered(config, after, Target(tip_m=target.tip_m)) is first
    assert asked.inverse == 0
    for other in (
        (after, Target(tip_m=beyond("trirack2", 0.31))),
        (replace(after, command=first.solution.actuation), target),
        (replace(after, since_s=state.since_s + 1.0), target),
    ):
        assert answered(config, *other) is not first
    assert (asked.inverse, asked.follow) == (3, 0)


@pytest.mark.parametrize(
    "name", ["stiffflop2", *(pytest.param(name, marks=pytest.mark.campaign) for name in ("cbha", "trirack2"))]
)
def test_the_nearest_pose_is_followed_and_not_searched_for(name: str) -> None:
    """As near as a search from many postures finds; far fewer searches than ticks."""
    run = started(name)
    streamed(run, [beyond(name, 0.3)] * 1200)
    asked = counted(run, MOTION_RULES)
    path = [beyond(name, 0.3 + 0.02 * math.sin(0.01 * k)) for k in range(300)]
    streamed(run, path)
    assert asked.inverse < 50 < 200 < asked.follow
    streamed(run, [path[-1]] * 1000)
    model, tip_m = run.config.model, path[-1]
    random, low, high = np.random.default_rng(7), np.array(run.config.model.lower), np.array(model.upper)
    left_m = []
    for _ in range(8):
        seed = tuple((low + random.uniform(0.0, 1.0, len(low)) * (high - low)).tolist())
        left_m.append(model.inverse(Target(tip_m=tip_m), seed).residual_m)
    reached_m = model.forward(run.engine.robots.states[0].command).tip_m
    assert math.dist(reached_m, tip_m) <= min(left_m) * 1.001 + 1e-6


def test_a_target_that_comes_back_within_reach_is_met() -> None:
    run = started("trirack2")
    home_m = run.config.model.forward(run.config.rest).tip_m
    streamed(run, [beyond("trirack2", 0.4)] * 600)
    asked = counted(run, MOTION_RULES)
    streamed(run, [home_m] * 1000)
    reached_m = run.config.model.forward(run.engine.robots.states[0].command).tip_m
    assert math.dist(reached_m, home_m) < 1e-6
    assert asked.follow <= 1


def test_the_kernel_searches_unless_a_stationary_answer_is_beside_the_seed() -> None:
    config = started("trirack2").config
    tip_m = (0.02, 0.0, 0.06)  # beside the retracted arm
    solve = getattr(config.model, "solver").solve  # noqa: B009 - of this model
    searched = solve(tip_m, None, None, config.rest)
    again = solve(tip_m, None, None, searched.lengths)
    followed = solve(tip_m, None, None, searched.lengths, None, True)
    assert followed.lengths == pytest.approx(again.lengths, abs=1e-9)
    assert (followed.starts, again.starts > 1) == (1, True)
    elsewhere = solve((0.8, 0.3, 1.2), None, None, config.rest).lengths
    assert solve(tip_m, None, None, elsewhere, None, True).starts > 1
