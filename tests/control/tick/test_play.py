"""Play of tendons: commands of the tick deliver what the model asked, by an operator of another module."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.config import RobotConfig
from contid.control.tick.limits import AxisLimits
from contid.control.tick.play import NO_LEAD, TURN, led, next_lead, next_senses, taken_up
from contid.control.tick.robot_tick import tick
from contid.control.tick.state import RobotState
from contid.control.tick.supervisor import Mode
from contid.control.tick.tip_feedback import Measurement
from contid.errors import BadInputError
from contid.hal import Sample
from contid.kinematics.tendon.capstan import play
from contid.robot_file.load import parse_robot_file
from contid.targets import Target
from contid_fit.calibrate.tendon.play_series import play_series


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


def test_an_axis_beyond_the_tendons_has_no_play(configs):
    text = (configs / "tendon3.yaml").read_text()
    grip = "    axes:\n      grip: {bus: servos, id: 40, mm_per_rev: 60}\n"
    text = text.replace("    axes:\n", f"    extra_mm: {{grip: [0, 30]}}\n{grip}", 1)
    text = text.replace("    rates:\n", "    friction: {play_mm: [0.3]}\n    rates:\n", 1)
    (config,) = build_robot_configs(parse_robot_file(text, "tendon3.yaml"), 100.0)
    assert config.extra_axes == 1
    assert config.play == (0.3e-3,) * 9 + (0.0,)


@pytest.mark.parametrize(("play_mm", "ticks"), [(0.3, 0), (1.0, 3)])
def test_what_was_asked_for_arrives(configs, play_mm, ticks):
    """The velocity limit is 0.6 mm per tick: a small play is taken up at once, a large one in a few ticks."""
    config = config_of(configs, f"    friction: {{play_mm: [{play_mm}]}}\n")
    commands, devices = followed(config, 400)
    assert np.abs(devices - commands).max() == pytest.approx(play_mm / 1e3)
    delivered = play_series(devices, play_mm / 1e3, commands[0])
    late = np.abs(delivered - commands) > TURN * play_mm / 1e3 + 1e-12
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
    up_and_down = (1.0, -1.0)
    offsets = taken_up((0.25, 0.25), (), up_and_down, (0.01, -0.01), limits)
    assert offsets == (0.1, -0.1)
    assert taken_up((0.25, 0.25), offsets, up_and_down, (0.0, 0.0), limits) == offsets
    for _ in range(3):
        offsets = taken_up((0.25, 0.25), offsets, up_and_down, (0.01, -0.01), limits)
    assert offsets == (0.25, -0.25)


def test_what_the_axes_deliver_is_the_play_operator_of_what_the_devices_do():
    """A random walk with rests, against the operator of the calibration."""
    rng = np.random.default_rng(7)
    limits = (AxisLimits(-1.0, 1.0, 0.5e-3, 1.0),) * 3
    half_width = (0.3e-3, 1e-3, 0.0)
    steps = rng.normal(0.0, 40e-6, (4000, 3)) * (rng.random((4000, 1)) < 0.8)
    commands, lead, devices, found = np.cumsum(steps, axis=0), NO_LEAD, [], []
    for command, step in zip(commands, steps, strict=True):
        lead = next_lead(half_width, None, lead, tuple(command), tuple(step), limits)
        devices.append(led(tuple(command), lead.added))
        found.append(lead.delivered)
        assert np.array(lead.ahead(tuple(command))) == pytest.approx(np.subtract(devices[-1], found[-1]))
    expected = play_series(np.array(devices), np.array(half_width), commands[0] - steps[0])
    np.testing.assert_allclose(np.array(found), expected, atol=1e-15)
    assert np.abs(np.diff(np.array(devices), axis=0)).max() <= 0.5e-3 + np.abs(steps).max() + 1e-12


def test_the_noise_of_a_tracker_does_not_turn_the_leads(configs):
    """A target that stands, measured with 0.3 mm: the devices move as the commands do, not by the play."""
    config = config_of(configs, "    friction: {play_mm: [0.5]}\n    feedback: {}\n")
    target, rng = path(config, 0.7), np.random.default_rng(1)
    assert target.tip_m is not None
    here = config.model.inverse(target, config.rest).actuation
    state = RobotState(
        mode=Mode.RUN, enabled=True, arm_requested=True, follow=True, command=config.rest,
        reference=config.rest, increments=(0.0,) * 9, misses=(0,) * 9,
    )  # fmt: skip
    device, delivered, measured = np.array(config.rest), np.array(config.rest), None
    devices, commands, errors = [], [], []
    for k in range(1000):
        now_s = 0.01 * k
        if k % 2 == 0:
            tip = np.array(config.model.forward(tuple(delivered)).tip_m) + rng.normal(0.0, 0.3e-3, 3)
            measured = Measurement(tuple(tip.tolist()), now_s)
        samples = tuple(
            Sample(value, now_s, True, 0.0) for value in config.transmission.to_device(tuple(device))
        )
        out = tick(config, state, now_s, samples, target, measured)
        state = out.state
        device = np.array(config.transmission.to_actuation(out.device))
        delivered = play(device, delivered, 0.5e-3)
        devices.append(device)
        commands.append(state.command)
        errors.append(math.dist(config.model.forward(tuple(delivered)).tip_m, target.tip_m))
    assert math.dist(state.command, here) < 1e-3
    travelled = [np.abs(np.diff(np.array(each[300:]), axis=0)).sum() for each in (devices, commands)]
    assert travelled[1] > 0.0
    assert travelled[0] < 3.0 * travelled[1]
    # It does not hunt in the play either.
    assert max(errors[300:]) < 0.5e-3


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


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_sense_of_motion_begins_and_turns_after_a_tenth_of_the_play(sense):
    play_m = (1.0, 1.0)
    assert next_senses(play_m, (), (5.0, 5.0), (5.0 + sense * 0.09, 5.0)) == (0.0, 0.0)
    begun = next_senses(play_m, (), (5.0, 5.0), (5.0 + sense * 0.11, 5.0))
    assert begun == (sense, 0.0)
    assert next_senses(play_m, begun, (5.0, 5.0), (5.0 - sense * 0.09, 5.0)) == begun
    assert next_senses(play_m, begun, (5.0, 5.0), (5.0 - sense * 0.11, 5.0)) == (-sense, 0.0)


class _Capstan:
    """Friction that asks for a lead of 1 and 0.5 at once."""

    def slides(self, before, command, increments):
        return (1.0, 1.0)

    def lead(self, command, slides):
        return np.array([1.0, 0.5])


@pytest.mark.parametrize("before", [(), (0.0, 0.0), (0.4, 0.2), (0.95, 0.475)])
def test_a_lead_of_friction_goes_on_from_where_it_was_within_the_step_of_every_axis(before):
    limits = [AxisLimits(-9.0, 9.0, 0.1, 1.0)] * 2
    capstan: Any = _Capstan()
    lead = next_lead(None, capstan, replace(NO_LEAD, friction=before), (5.0, 5.0), (0.1, 0.1), limits)
    expected = min((before or (0.0,))[0] + 0.1, 1.0)
    assert lead.friction == pytest.approx((expected, 0.5 * expected))
    assert lead.added == lead.friction
