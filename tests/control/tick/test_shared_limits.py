"""Axes that are followed at their pace stop before the limits that they share, such as a bend radius.

Limits are those of the robot file; bends follow from lengths by the textbook (`tests.oracles.arcs`), those of
the finger from Morita et al., Eq. 1 to 3.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import brentq

from contid.control.tick.config import RobotConfig
from contid.control.tick.limits import POSITION, VELOCITY, AxisLimits
from contid.control.tick.next_command import next_command
from contid.control.tick.shared_limits import _ahead, _Bound, _braked, limit_shared
from contid.kinematics.arc.section_model import SectionModel
from contid.kinematics.model import build_model
from contid.kinematics.rack.finger import RackFingerModel
from contid.robot_file.load import load_named
from contid.targets import Actuation, Target
from tests.oracles.arcs import bends
from tests.support.robot_configs import SLACK, config_of

#: Rounding and the curvature of a cone within one tick [m].
NEAR_M = 5e-6


def excess_of(name: str) -> Callable[[Actuation], float]:
    """By how much a command exceeds limits that axes share [m], negative inside."""
    (robot,) = load_named(name).file.robots.values()
    model = build_model(robot)
    if isinstance(model, RackFingerModel):
        finger = model

        def bent(command: Actuation) -> float:
            length, theta = finger.arc(command)
            return finger.rack_spacing_m * (abs(theta) - finger.envelope.curvature_max_per_m * length)

        return bent
    assert isinstance(model, SectionModel)
    feasible = model.feasible

    def exceeded(command: Actuation) -> float:
        own = np.array(command[: 3 * feasible.sections.count])
        found = [float(own.reshape(-1, 3).sum(axis=0).max()) - feasible.rack_m]
        for (theta, _, length), radius_m in zip(
            bends(feasible, own), feasible.sections.radius_m, strict=True
        ):
            found.append(radius_m * (theta - feasible.curvature_max * length))
        return max(found)

    return exceeded


def followed(config: RobotConfig, goals: np.ndarray, start: Actuation) -> list[Actuation]:
    """Commands that follow lengths, one row per tick; each is brought inside the limits by the model."""
    command, steps, reference, straight, seen = start, (0.0,) * len(start), start, False, []
    for row in goals:
        target = Target(actuation=tuple(row.tolist()))
        answer = config.model.inverse(target, command).actuation
        paces = [new - old for new, old in zip(answer, reference, strict=True)]
        after, _, straight = next_command(config, command, steps, answer, paces, target, straight)
        steps = tuple(new - old for new, old in zip(after, command, strict=True))
        command, reference = after, answer
        seen.append(after)
    return seen


@pytest.mark.parametrize("name", ["finger", "trirack", pytest.param("trirack2", marks=pytest.mark.campaign)])
def test_axes_at_any_pace_stop_before_the_limits_they_share(name: str) -> None:
    """An axis that went at 40 mm/s up to the bend radius of a finger ended 0.43 mm beyond it."""
    config, rng, beyond_m = config_of(name), np.random.default_rng(3), excess_of(name)
    own = len(config.rest) - config.extra_axes
    low, high = (np.array(side[:own]) for side in (config.model.lower, config.model.upper))
    middle = Target(actuation=tuple((0.5 * (low + high)).tolist()))
    start = config.model.inverse(middle, config.rest).actuation
    farthest, near = -np.inf, 0
    for _ in range(2):
        steps = np.array([each.step for each in config.limits[:own]])
        # A walk at up to the greatest speed, whose ends lie anywhere between the ends of the axes.
        goals: list[np.ndarray] = []
        at = np.array(start[:own])
        while len(goals) < 400:
            end, pace = rng.uniform(low, high), rng.uniform(0.2, 1.0)
            ticks = int(np.ceil((np.abs(end - at) / (pace * steps)).max())) + 1
            goals += list(np.linspace(at, end, ticks, endpoint=False))
            at = end
        commands = np.array([start, *followed(config, np.array(goals), start)])
        excess = [beyond_m(tuple(each)) for each in commands.tolist()]
        farthest, near = max(farthest, *excess), near + sum(each > -1e-5 for each in excess)
        moves = np.diff(commands, axis=0)
        for axis, each in enumerate(config.limits):
            assert np.abs(moves[:, axis]).max() <= each.step * SLACK
            assert np.abs(np.diff(moves[:, axis])).max() <= each.change * SLACK
    assert near > 20  # it was at a limit
    assert farthest <= NEAR_M


def test_a_single_axis_stops_without_moving_another() -> None:
    config, beyond_m = config_of("finger"), excess_of("finger")
    end_m = brentq(lambda left_m: beyond_m((left_m, 0.06)), 0.0, 0.06) + 1e-9
    goals = np.array([(max(0.06 - k * 4e-4, end_m), 0.06) for k in range(300)])
    commands = followed(config, goals, (0.06, 0.06))
    assert max(map(beyond_m, commands)) <= 1e-12
    assert commands[-1] == (end_m, 0.06)
    assert {right for _, right in commands} == {0.06}


@pytest.mark.parametrize("share", [0.5, 0.98])
def test_a_path_that_touches_a_shared_limit_in_passing_is_followed_exactly(share: float) -> None:
    """Both racks shed and gain speed within their acceleration; the bend just touches its limit."""
    config = config_of("finger")
    model = config.model
    assert isinstance(model, RackFingerModel)
    # Middle and bend of the racks; the bend goes as a parabola with the share of what both can do.
    change = config.limits[0].change
    ticks = np.arange(-5, 6)
    middle = 0.05 + 1e-5 * ticks
    most = np.array([model.envelope.curvature_bound(s) * s * model.rack_spacing_m for s in middle])
    bend = most - share * change * ticks**2
    goals = np.stack((middle - 0.5 * bend, middle + 0.5 * bend), axis=1)
    assert np.abs(np.diff(goals, n=2, axis=0)).max() <= change
    start = tuple(goals[0].tolist())
    command, steps = start, tuple((goals[1] - goals[0]).tolist())
    for row, pace in zip(goals[1:-1], np.diff(goals, axis=0), strict=False):
        goal = tuple(row.tolist())
        after, flags, _ = next_command(config, command, steps, goal, pace.tolist(), Target(actuation=goal))
        assert after == goal, flags
        steps = tuple(new - old for new, old in zip(after, command, strict=True))
        command = after


@pytest.mark.parametrize(("too_far", "share"), [(0.1, 0.05), (0.5, 0.25), (1.9, 0.95), (2.1, 1.0)])
def test_axes_brake_by_the_share_that_a_limit_needs(too_far: float, share: float) -> None:
    """Slopes 1 and -0.5 of axes that can each go back by twice 0.5 and 1; the third one has no part in it."""
    brakes, ends = (0.5, 1.0, 1.0), [(-9.0, 9.0)] * 3
    command = (3.0, 4.0, 5.0)
    bound = _Bound(too_far, (1.0, -0.5, 0.0))
    braked, enough = _braked(brakes, ends, (2.0, 5.0, 4.0), command, bound)
    assert enough == (too_far <= 2.0)
    assert braked == pytest.approx((3.0 - share, 4.0 + 2.0 * share, 5.0))


def test_an_axis_brakes_no_further_than_its_own_limits_allow() -> None:
    braked, enough = _braked(
        (5.0, 5.0), [(0.5, 2.0), (-2.0, -0.5)], (2.0, 5.0), (3.0, 4.0), _Bound(9.0, (1.0, -1.0))
    )
    assert not enough
    assert braked == (2.5, 4.5)


@pytest.mark.parametrize("ticks", [1, 2, 5, 40])
def test_axes_that_stop_together_go_on_by_all_shorter_steps(ticks: int) -> None:
    limits = [AxisLimits(-9.0, 9.0, 9.0, 0.25), AxisLimits(-9.0, 9.0, 9.0, 0.25)]
    slowed = sum(0.25 * k for k in range(ticks))
    assert _ahead([0.25 * ticks, 0.125 * ticks], limits) * 0.25 * ticks == pytest.approx(slowed)
    assert _ahead([0.1, 0.0], limits) == 0.0


class _Sum:
    """The first two of three axes may not add up to more than 1."""

    def excess(self, actuation: Actuation) -> list[float]:
        return [actuation[0] + actuation[1] - 1.0]

    def gradient(self, actuation: Actuation, number: int) -> list[float]:
        return [1.0, 1.0, 0.0]


def test_only_axes_that_a_shared_limit_brakes_are_flagged() -> None:
    """From a step of 0.03 of the sum, with 0.02 less per tick, it stops within the room of 0.04."""
    limits = [AxisLimits(-9.0, 9.0, 0.1, 0.01)] * 3
    last, steps, command = (0.48, 0.48, 0.0), (0.02,) * 3, (0.5, 0.5, 0.02)
    kept, flags = limit_shared(_Sum(), limits, last, steps, (command, (VELOCITY, 0, VELOCITY)))
    assert kept == pytest.approx((0.495, 0.495, 0.02))
    assert kept[2] == 0.02
    assert flags == (VELOCITY | POSITION, POSITION, VELOCITY)


@pytest.mark.parametrize("name", ["finger", "trirack2", "catheter"])
def test_a_command_that_stays_clear_of_shared_limits_is_left_as_it_is(name: str) -> None:
    """The look that saves the closer one is right wherever it succeeds, from deep inside up to the limits."""
    config, rng = config_of(name), np.random.default_rng(44)
    assert config.shared is not None
    lower, upper = (np.array(side) for side in zip(*((e.lower, e.upper) for e in config.limits), strict=True))
    step, change = (np.array(side) for side in zip(*((e.step, e.change) for e in config.limits), strict=True))
    clear = closer = 0
    for _ in range(1000):
        middle = 0.5 * (lower + upper)
        last = middle + rng.uniform(0.0, 1.0) * (rng.uniform(lower, upper) - middle)
        steps = rng.uniform(-1.0, 1.0) * step * rng.uniform(-1.0, 1.0, len(step))
        command = tuple((last + np.clip(steps + rng.uniform(-change, change), -step, step)).tolist())
        here, flags = tuple(last.tolist()), (0,) * len(last)
        if config.guard.stays_clear(here, command):
            kept = limit_shared(config.shared, config.limits, here, tuple(steps.tolist()), (command, flags))
            assert kept == (command, flags)
            clear += 1
        else:
            closer += 1
    assert clear > 100
    assert closer > 20
