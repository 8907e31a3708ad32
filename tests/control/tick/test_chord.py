"""Jumps of a target: the tip goes along the chord, all axes keep their limits and those of the model."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest

from contid.control.tick.config import RobotConfig
from contid.control.tick.next_command import limit_on_path
from contid.kinematics.array import Array
from contid.targets import Actuation, Target, Vec3
from tests.support.robot_configs import SLACK, config_of, postures

#: The tip may leave the chord by this [m]; for rods the statics are computed to 5e-5 m.
OFF_M = {"finger": 1e-6, "cbha": 1e-6, "trirack": 1e-6, "trirack2": 1e-6, "stiffflop2": 5e-5}
MOST_TICKS = 3000


@dataclass(frozen=True)
class Jump:
    """Commands of a robot after a jump of its target."""

    commands: Array
    tips_m: Array
    straight: bool
    arrived: bool

    def off_chord_m(self, target_m: Vec3) -> float:
        """Greatest distance of a tip from the chord between the first one and the target."""
        begin, away = self.tips_m[0], np.array(target_m) - self.tips_m[0]
        share = np.clip((self.tips_m - begin) @ away / (away @ away), 0.0, 1.0)
        return float(np.linalg.norm(self.tips_m - begin - share[:, None] * away, axis=1).max())


def jump(config: RobotConfig, start: Actuation, target: Target, steps: Actuation = ()) -> Jump:
    """Follow a target from ``start``, with ``steps`` of the tick before; all limits are checked."""
    model, own = config.model, len(start) - config.extra_axes
    commands, command, reference = [start], start, start
    steps = steps or (0.0,) * len(start)
    before, straight, ever = np.array(steps), False, False
    for _ in range(MOST_TICKS):
        answer = model.inverse(target, command).actuation
        paces = [new - old for new, old in zip(answer, reference, strict=True)]
        after, _, straight = limit_on_path(config, command, steps, answer, paces, target, straight)
        ever |= straight
        steps = tuple(new - old for new, old in zip(after, command, strict=True))
        command, reference = after, answer
        commands.append(command)
        if command == answer and not any(steps[:own]):
            break
    path = np.array(commands)
    moves = np.vstack([before, np.diff(path, axis=0)])
    for axis, each in enumerate(config.limits[:own]):
        assert np.abs(moves[:, axis]).max() <= each.step * SLACK
        assert np.abs(np.diff(moves[:, axis])).max() <= each.change * SLACK
        assert path[:, axis].min() >= each.lower - 1e-12 * abs(each.lower)
        assert path[:, axis].max() <= each.upper * SLACK
    tips = np.array([model.forward(tuple(row.tolist())).tip_m for row in path])
    assert target.tip_m is not None
    return Jump(path, tips, ever, math.dist(tips[-1], target.tip_m) <= 5e-5)


@pytest.mark.parametrize(
    "name",
    [
        "finger",
        "trirack2",
        "stiffflop2",
        *(pytest.param(each, marks=pytest.mark.campaign) for each in ("cbha", "trirack")),
    ],
)
def test_the_tip_stays_on_the_chord_of_a_jump(name: str) -> None:
    config, rng = config_of(name), np.random.default_rng(16)
    for _ in range(3):
        start, tip_m = postures(config, rng, 0.3, 0.7)
        found = jump(config, start, Target(tip_m=tip_m))
        assert found.arrived
        assert not found.straight
        assert found.off_chord_m(tip_m) <= OFF_M[name]


def test_a_direction_turns_with_the_tip() -> None:
    config, rng = config_of("trirack2"), np.random.default_rng(5)
    for _ in range(2):
        start, tip_m = postures(config, rng, 0.4, 0.6)
        pose = config.model.forward(start)
        x, y, z = pose.direction
        size = math.hypot(x + 0.1, y, z)
        direction = ((x + 0.1) / size, y / size, z / size)
        target = Target(tip_m=tip_m, direction=direction)
        if not config.model.inverse(target, start).converged:
            continue
        found = jump(config, start, target)
        assert found.arrived
        reached = config.model.forward(tuple(found.commands[-1].tolist())).direction
        assert math.dist(reached, direction) < 1e-6
        if not found.straight:
            assert found.off_chord_m(tip_m) <= 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("name", ["finger", "trirack", pytest.param("trirack2", marks=pytest.mark.campaign)])
def test_where_the_chord_leaves_the_reach_the_limits_of_the_model_hold(name: str) -> None:
    """Whole range, bend radius included; the arm arrives, on the axes' own line if need be."""
    config, rng = config_of(name), np.random.default_rng(7)
    strayed = 0
    for _ in range(2 if name == "trirack2" else 4):
        start, tip_m = postures(config, rng, 0.05, 0.95, 0.3)
        found = jump(config, start, Target(tip_m=tip_m))
        assert found.arrived
        strayed += found.straight
        for row in found.commands[::7]:
            command = tuple(row.tolist())
            kept = config.model.inverse(Target(actuation=command), command)
            assert np.abs(np.subtract(kept.actuation, command)).max() <= 1e-5, kept
    assert strayed or name == "trirack2"


def test_an_arm_that_moves_turns_to_the_new_chord() -> None:
    """A jump aside in mid-motion: limits hold, and it arrives."""
    config, rng = config_of("cbha"), np.random.default_rng(2)
    for _ in range(3):
        start, first_m = postures(config, rng, 0.3, 0.7)
        on_way = jump(config, start, Target(tip_m=first_m)).commands
        k = len(on_way) // 3
        steps = tuple((on_way[k] - on_way[k - 1]).tolist())
        _, second_m = postures(config, rng, 0.3, 0.7)
        found = jump(config, tuple(on_way[k].tolist()), Target(tip_m=second_m), steps)
        assert found.arrived


def test_a_robot_outside_its_limits_goes_inwards() -> None:
    config = config_of("finger")
    middle = tuple(0.5 * (each.lower + each.upper) for each in config.limits)
    start = tuple(each.upper + 0.01 * (each.upper - each.lower) for each in config.limits)
    target = Target(tip_m=config.model.forward(middle).tip_m)
    still = (0.0,) * len(start)
    answer = config.model.inverse(target, start).actuation
    after, _, _ = limit_on_path(config, start, still, answer, still, target)
    assert all(new < old for new, old in zip(after, start, strict=True))


def test_an_axis_near_its_end_brakes_by_itself() -> None:
    """Two racks of a finger, which may go on by their own limits and then have to stop for another target."""
    config = config_of("finger")
    left, right = config.limits
    steps = (3.6 * left.change, -4.4 * right.change)
    command: Actuation = (
        left.upper - 4.5 * left.change,
        0.5 * (right.lower + right.upper),
    )  # room for 2.6 + 1.6 + 0.6
    for _ in range(6):
        target = Target(actuation=(0.9 * left.upper, command[1]))
        assert target.actuation is not None
        after, _, _ = limit_on_path(config, command, steps, target.actuation, (0.0, 0.0), target)
        steps = (after[0] - command[0], after[1] - command[1])
        command = after
        assert command[0] <= left.upper


@pytest.mark.parametrize(
    "name", ["finger", "trirack", "stiffflop2", pytest.param("cbha", marks=pytest.mark.campaign)]
)
def test_a_robot_at_rest_catches_up_with_a_target_that_goes_on(name: str) -> None:
    """The target begins a part of its way ahead and needs the speed of several ticks' acceleration."""
    config = config_of(name)
    model, rng = config.model, np.random.default_rng(6)
    start, end_m = postures(config, rng, 0.4, 0.6)
    begin_m = np.array(model.forward(start).tip_m)
    way_m = np.array(end_m) - begin_m
    command, steps, straight = start, (0.0,) * len(start), False
    reference: Actuation | None = None
    off_m = []
    for count in range(400):
        x, y, z = (begin_m + min(0.3 + 0.002 * count, 1.0) * way_m).tolist()
        target = Target(tip_m=(x, y, z))
        answer = model.inverse(target, command).actuation
        paces = [new - old for new, old in zip(answer, reference or answer, strict=True)]
        after, _, straight = limit_on_path(config, command, steps, answer, paces, target, straight)
        steps = tuple(new - old for new, old in zip(after, command, strict=True))
        command, reference = after, answer
        off_m.append(math.dist(model.forward(command).tip_m, (x, y, z)))
    caught = next(count for count, off in enumerate(off_m) if off < 1e-4)
    assert caught < 250
    assert max(off_m[:caught]) < 1.2 * off_m[0]
    assert max(off_m[caught + 20 : 350]) < 1e-4  # then the target stops at once
