"""Approaches of arms whose limits are shared by several axes, such as a bend radius.

The limits are those of the robot file; bends follow from lengths by the textbook (`tests.oracles.arcs`).
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.config import RobotConfig
from contid.control.tick.robot_tick import tick
from contid.control.tick.state import RobotState
from contid.control.tick.supervisor import Mode
from contid.hal import Sample
from contid.kinematics.arc.feasible import Feasible
from contid.kinematics.arc.section_model import SectionModel
from contid.kinematics.model import build_model
from contid.robot_file.load import load_named
from contid.targets import Actuation, Target
from tests.oracles.arcs import bends, lengths_of

RATE_HZ = 100.0


def at_the_bend_radius(feasible: Feasible, rng: np.random.Generator) -> Actuation:
    """Lengths inside every limit, every section bent as far as its radius allows."""
    while True:
        arcs = []
        for low, high in zip(feasible.lower, feasible.upper, strict=True):
            length = rng.uniform(low, high)
            arcs.append((feasible.curvature_max * length, rng.uniform(-math.pi, math.pi), length))
        lengths = lengths_of(feasible, arcs)
        if feasible.excess(lengths)[:-2].max() < 0.0:
            return tuple(lengths.tolist())


def commands_to(config: RobotConfig, here: Actuation, goal: Actuation) -> list[Actuation]:
    """Commands of the tick from HOLD to a goal; devices arrive at their commands at once."""
    still = (0.0,) * len(here)
    state = RobotState(
        mode=Mode.HOLD, enabled=True, arm_requested=True, follow=False, command=here, reference=here,
        increments=still, misses=(0,) * len(here), goto=Target(actuation=goal),
    )  # fmt: skip
    seen = []
    for number in range(5000):
        values = config.transmission.to_device(state.command)
        samples = tuple(Sample(value, number / RATE_HZ, True, 0.0) for value in values)
        state = tick(config, state, (number + 1) / RATE_HZ, samples, None).state
        seen.append(state.command)
        if state.mode is Mode.HOLD and state.goto is None:
            return seen
    raise AssertionError("it does not arrive")


@pytest.mark.parametrize("seed", range(6))
def test_no_command_of_an_approach_is_bent_beyond_the_radius(seed: int) -> None:
    """Axes that arrive together but each with a profile of its own left it by up to 0.8 mm of rack."""
    loaded = load_named("trirack2")
    (config,) = build_robot_configs(loaded, RATE_HZ)
    (robot,) = loaded.file.robots.values()
    model = build_model(robot)
    assert isinstance(model, SectionModel)
    feasible, rng = model.feasible, np.random.default_rng(seed)
    own = len(model.axis_names)
    begin, goal = (at_the_bend_radius(feasible, rng) + config.rest[own:] for _ in range(2))
    commands = commands_to(config, begin, goal)
    assert commands[-1] == pytest.approx(goal, abs=1e-12)
    for command in commands:
        for theta, _, length in bends(feasible, np.array(command[:own])):
            assert theta <= feasible.curvature_max * length + 1e-9
