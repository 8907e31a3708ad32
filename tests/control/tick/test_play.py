"""Play of tendons: commands of the tick deliver what the model asked, by an operator of another module."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.config import RobotConfig
from contid.control.tick.limits import AxisLimits
from contid.control.tick.play import taken_up
from contid.control.tick.robot_tick import tick
from contid.control.tick.state import RobotState
from contid.control.tick.supervisor import Mode
from contid.errors import BadInputError
from contid.hal import Sample
from contid.kinematics.tendon.friction import play_series
from contid.robot_file.load import parse_robot_file
from contid.targets import Target


def config_of(configs: Path, friction: str) -> RobotConfig:
    text = (configs / "tendon3.yaml").read_text().replace("    rates:\n", f"{friction}    rates:\n", 1)
    (config,) = build_robot_configs(parse_robot_file(text, "tendon3.yaml"), 100.0)
    return config


def path(config: RobotConfig, time_s: float) -> Target:
    x, y = 0.05 * math.cos(2.0 * time_s), 0.05 * math.sin(3.0 * time_s)
    z = config.model.forward(config.rest).tip_m[2] - 0.03
    return Target(tip_m=(x, y, z))


def followed(config: RobotConfig, ticks: int) -> tuple[np.ndarray, np.ndarray]:
    """Commands of the robot and what its devices get [m], along a path with turns of direction."""
    here = config.model.inverse(path(config, 0.0), config.rest).actuation
    state = RobotState(
        mode=Mode.RUN, enabled=True, arm_requested=True, follow=True, command=here, reference=here,
        increments=(0.0,) * 9, misses=(0,) * 9,
    )  # fmt: skip
    samples = tuple(Sample(value, 0.0, True, 0.0) for value in config.transmission.to_device(here))
    commands, devices = [], []
    for k in range(ticks):
        out = tick(config, state, 0.01 * k, samples, path(config, 0.01 * k))
        state = out.state
        commands.append(state.command)
        devices.append(config.transmission.to_actuation(out.device))
    return np.array(commands), np.array(devices)


@pytest.mark.parametrize(("play_mm", "ticks"), [(0.3, 0), (1.0, 3)])
def test_what_was_asked_for_arrives(configs, play_mm, ticks):
    """The velocity limit is 0.6 mm per tick: a small play is taken up at once, a large one in a few ticks."""
    config = config_of(configs, f"    friction: {{play_mm: [{play_mm}]}}\n")
    commands, devices = followed(config, 400)
    assert np.abs(devices - commands).max() == pytest.approx(play_mm / 1e3)
    delivered = play_series(devices, play_mm / 1e3, commands[0])
    late = np.abs(delivered - commands) > 1e-12
    directions = np.sign(np.diff(commands, axis=0))
    turns = 9 + int((np.diff(directions, axis=0) != 0.0).sum())
    assert late.sum() <= ticks * turns
    assert bool(late.any()) is (ticks > 0)


def test_without_play_nothing_changes(configs):
    plain = followed(config_of(configs, ""), 50)
    off = followed(config_of(configs, "    friction: {play_mm: [0]}\n"), 50)
    np.testing.assert_array_equal(plain[0], off[0])
    np.testing.assert_array_equal(plain[1], off[1])
    assert plain[0] == pytest.approx(plain[1], abs=1e-15)


def test_at_rest_the_offset_stays_and_a_turn_is_bounded_by_the_velocity():
    limits = (AxisLimits(-1.0, 1.0, 0.1, 0.01),) * 2
    offsets = taken_up((0.25, 0.25), (), (0.01, -0.01), limits)
    assert offsets == (0.1, -0.1)
    assert taken_up((0.25, 0.25), offsets, (0.0, 0.0), limits) == offsets
    for _ in range(3):
        offsets = taken_up((0.25, 0.25), offsets, (0.01, -0.01), limits)
    assert offsets == (0.25, -0.25)


def test_a_target_that_stands_does_not_turn_the_lead(configs):
    """Answers to one target differ by rounding from tick to tick; the devices stand still all the same."""
    config = config_of(configs, "    friction: {play_mm: [0.3], capstan: [0.1]}\n")
    target = path(config, 0.7)
    here = config.model.inverse(target, config.rest).actuation
    state = RobotState(
        mode=Mode.RUN, enabled=True, arm_requested=True, follow=True, command=config.rest,
        reference=config.rest, increments=(0.0,) * 9, misses=(0,) * 9,
    )  # fmt: skip
    samples = tuple(Sample(value, 0.0, True, 0.0) for value in config.transmission.to_device(here))
    devices = []
    for k in range(300):
        out = tick(config, state, 0.01 * k, samples, target)
        state = out.state
        devices.append(out.device)
    stood = np.array(devices[200:])
    assert np.abs(stood - stood[0]).max() < 1e-9
    assert np.abs(state.lead.play) == pytest.approx([0.3e-3] * 9)


def test_a_wrong_number_of_plays_is_refused(configs):
    with pytest.raises(BadInputError, match=r"friction\.play_mm has 2 numbers; allowed: 1, 3 or 9"):
        config_of(configs, "    friction: {play_mm: [0.1, 0.2]}\n")
