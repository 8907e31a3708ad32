"""A hold in mid-motion ends inside the limits that axes share, such as a bend radius."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from contid.control.tick.config import RobotConfig
from contid.control.tick.next_command import limit_on_path
from contid.control.tick.state import RobotState
from contid.control.tick.supervisor import Mode
from contid.control.tick.transitions import hold
from contid.targets import Actuation, Target
from tests.support.robot_configs import SLACK, config_of, postures


def _beyond(config: RobotConfig, command: Actuation) -> float:
    """How far a command is beyond the limits of the model [m or Pa]."""
    kept = config.model.inverse(Target(actuation=command), command).actuation
    return float(np.abs(np.subtract(kept, command)).max())


def _held(config: RobotConfig, command: Actuation, steps: Actuation) -> list[Actuation]:
    """The commands from a hold to standstill."""
    state = replace(
        RobotState(), mode=Mode.RUN, enabled=True, command=command, increments=steps, reference=command
    )
    motion = hold(config, state, config.period_s).motion
    assert motion is not None
    ticks = round(motion.duration_s / config.period_s) + 2
    return [motion.at(k * config.period_s)[0] for k in range(ticks)]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["finger", "trirack"])
def test_a_hold_anywhere_on_the_way_ends_inside_the_limits_of_the_model(name: str) -> None:
    config, rng = config_of(name), np.random.default_rng(7)
    farthest = 0.0
    for _ in range(6):
        start, tip_m = postures(config, rng, 0.05, 0.95, 0.3)
        target = Target(tip_m=tip_m)
        command, reference, steps, straight = start, start, (0.0,) * len(start), False
        for tick in range(400):
            answer = config.model.inverse(target, command).actuation
            paces = [new - old for new, old in zip(answer, reference, strict=True)]
            after, _, straight = limit_on_path(config, command, steps, answer, paces, target, straight)
            steps = tuple(new - old for new, old in zip(after, command, strict=True))
            command, reference = after, answer
            if not any(steps):
                break
            if tick % 6:
                continue
            way = _held(config, command, steps)
            farthest = max(farthest, *(_beyond(config, each) for each in way))
            moves = np.diff(np.array([np.subtract(command, steps), *way]), axis=0)
            for axis, each in enumerate(config.limits):
                assert np.abs(np.diff(moves[:, axis])).max() <= each.change * SLACK
    assert farthest <= 2e-5  # 0.5e-3 with a stop that is limited in jerk
