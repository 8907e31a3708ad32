"""Friction of tendons: the emulated robot, where it is formulated apart, bends as the model asked."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from contid.control.engine.wiring import build_robot_configs, wired_buses
from contid.control.tick.config import RobotConfig
from contid.control.tick.play import Lead, next_lead
from contid.control.tick.robot_tick import tick
from contid.control.tick.state import RobotState
from contid.control.tick.supervisor import Mode
from contid.errors import BadInputError
from contid.hal import Sample
from contid.kinematics.tendon.model import TendonModel
from contid.robot_file.load import LoadedFile, parse_robot_file
from contid.targets import Target
from contid_emulate.dynamixel.bench import servo_of, tendons_of
from contid_emulate.dynamixel.tendon_friction import FrictionPlant
from tests.kinematics.tendon_robots import random_bends

HOMING = ", homing: {method: tension, direction: 1, current_ma: 80}}"
FRICTION = "    friction: {play_mm: [0.3], capstan: [0.1]}\n"


def loaded(configs: Path, friction: str = FRICTION) -> LoadedFile:
    text = (configs / "tendon3.yaml").read_text().replace("    rates:\n", f"{friction}    rates:\n", 1)
    return parse_robot_file(re.sub(r"(mm_per_rev: [0-9.]+)}", rf"\1{HOMING}", text), "tendon3.yaml")


def path(config: RobotConfig, time_s: float) -> Target:
    x, y = 0.05 * math.cos(2.0 * time_s), 0.05 * math.sin(3.0 * time_s)
    z = config.model.forward(config.rest).tip_m[2] - 0.03
    return Target(tip_m=(x, y, z))


class Emulated:
    """Servos with tendons on their spools, placed at once where they are commanded."""

    def __init__(self, file: LoadedFile) -> None:
        (bus,) = wired_buses(file)
        self.servos = [servo_of(axis, 1_000_000) for axis in bus.axes]
        (self.plant,) = tendons_of(self.servos, bus.axes)
        (config,) = build_robot_configs(file, 100.0)
        assert isinstance(config.model, TendonModel)
        assert config.model.statics is not None
        statics = config.model.statics
        #: Straight at the pretension, which homing makes the zero of the pulls.
        self.rest_ticks = statics.rest_n / statics.tendon_n_per_m * 4096 / (2 * math.pi * 0.010)

    def goes(self, device: tuple[float, ...]) -> None:
        for servo, angle, rest in zip(self.servos, device, self.rest_ticks, strict=True):
            servo.motion.position = angle * 4096 / math.tau + rest
        self.plant.tensions_ma()


def followed(config: RobotConfig, emulated: Emulated, ticks: int) -> tuple[np.ndarray, np.ndarray]:
    """Bends that the model asked for, and those of the emulated backbone [rad]."""
    assert isinstance(config.model, TendonModel)
    assert isinstance(emulated.plant, FrictionPlant)
    state = RobotState(
        mode=Mode.RUN, enabled=True, arm_requested=True, follow=True, command=(0.0,) * 9,
        reference=(0.0,) * 9, increments=(0.0,) * 9, misses=(0,) * 9,
    )  # fmt: skip
    samples = tuple(Sample(value, 0.0, True, 0.0) for value in config.transmission.to_device((0.0,) * 9))
    emulated.goes(tuple(sample.value or 0.0 for sample in samples))
    emulated.plant.held = False
    asked, got = [], []
    for k in range(ticks):
        out = tick(config, state, 0.01 * k, samples, path(config, 0.01 * k))
        state = out.state
        emulated.goes(out.device)
        asked.append(config.model.bends(state.command))
        got.append(emulated.plant.bends)
    return np.array(asked), np.array(got)


@pytest.fixture(scope="module")
def both(request: pytest.FixtureRequest) -> tuple[np.ndarray, np.ndarray]:
    """Errors of the bends with the lead and without [rad]."""
    configs = Path(__file__).parents[3] / "configs"
    file = loaded(configs)
    (config,) = build_robot_configs(file, 100.0)
    errors = []
    for each in (config, replace(config, play=None, capstan=None)):
        asked, got = followed(each, Emulated(file), 320)
        errors.append(np.abs(got - asked)[150:].max(axis=1))
    return errors[0], errors[1]


@pytest.mark.slow
def test_the_delivered_bends_are_what_the_model_asked_for(both):
    """Turns come a tenth of the play late, and take a few ticks, as the velocity allows 0.6 mm per tick."""
    led, plain = both
    assert np.median(plain) > 0.05
    assert np.median(led) < 5e-3 * np.median(plain)
    assert np.max(led) < 0.06 * np.max(plain)


def test_every_tendon_stays_taut_and_below_its_limit(configs):
    file = loaded(configs, "    friction: {capstan: [0.1]}\n")
    (config,) = build_robot_configs(file, 100.0)
    emulated = Emulated(file)
    followed(config, emulated, 120)
    assert isinstance(config.model, TendonModel)
    assert config.model.statics is not None
    tensions = emulated.plant.tensions_ma() / (1470.0 / 0.52 * 0.010)
    assert np.min(tensions) > 0.95 * config.model.statics.floor_n
    assert np.max(tensions) < config.model.statics.limit_n


def test_leads_change_together_and_at_most_at_the_velocity(configs):
    (config,) = build_robot_configs(loaded(configs, "    friction: {capstan: [0.3]}\n"), 100.0)
    command = config.model.inverse(path(config, 0.3), config.rest).actuation
    assert config.capstan is not None
    before = Lead()
    goal = config.capstan.lead(command, (1.0,) * 27)
    for _ in range(20):
        after = next_lead(None, config.capstan, before, command, (1e-3,) * 9, config.limits)
        moved = np.array(after.added) - np.array(before.added or (0.0,) * 9)
        assert np.abs(moved).max() <= config.limits[0].step * (1.0 + 1e-12)
        before = after
    standing = next_lead(None, config.capstan, before, command, (0.0,) * 9, config.limits)
    assert standing == before
    assert np.shape(goal) == (9,)


def test_no_tension_is_led_over_its_limit(configs):
    (config,) = build_robot_configs(loaded(configs, "    friction: {capstan: [1.0]}\n"), 100.0)
    assert isinstance(config.model, TendonModel)
    assert config.model.statics is not None
    assert config.capstan is not None
    statics = config.model.statics
    rng = np.random.default_rng(3)
    for bends in random_bends(config.model, 50, 4):
        pulls = tuple(config.model.statics.pulls(bends).tolist())
        lead = config.capstan.lead(pulls, tuple(rng.uniform(-1.0, 1.0, 27).tolist()))
        tensions = statics.tensions(np.array(pulls)) + statics.tendon_n_per_m * lead
        assert tensions.max() <= statics.limit_n * (1.0 + 1e-9)


@pytest.mark.parametrize(
    ("friction", "message"),
    [
        ("{capstan: [0.1, 0.2]}", r"38:25: .*friction\.capstan has 2 entries; allowed: 1 or 3"),
        ("{capstan: [1.5]}", r"38:26: capstan: item 1: allowed is a number at most 1, not 1\.5"),
        ("{capstan: [0.1]}\n    rod: {}", r"38:25: .*leads the model of arcs; leave out rod or capstan"),
        ("{mu: [0.1]}", r"38:16: unknown key 'mu'; allowed: play_mm, capstan"),
    ],
)
def test_wrong_friction_is_refused_where_it_is_written(configs, friction, message):
    with pytest.raises(BadInputError) as refused:
        loaded(configs, f"    friction: {friction}\n")
    assert len(refused.value.findings) == 1
    assert re.search(message, str(refused.value))
