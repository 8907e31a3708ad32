"""Straight lines of the tip to rows that jump: none is far slower than the axes together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from contid.control.engine.live.tip_line import TipLine, tip_line
from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.axis_motions import PresentRates, motion_to
from contid.control.tick.config import RobotConfig
from contid.robot_file.load import load_named
from contid.targets import Actuation, Target


def jumps(config: RobotConfig, count: int) -> list[tuple[TipLine | None, float]]:
    """Lines between random tips, and how long the axes alone take to the tip of each [s]."""
    rng = np.random.default_rng(5)
    lower, upper = np.array(config.model.lower), np.array(config.model.upper)
    found = []
    for _ in range(count):
        start, end = (
            tuple((lower + rng.uniform(0.25, 0.75, len(lower)) * (upper - lower)).tolist()) for _ in range(2)
        )
        places = (config.frame.point_in_world(config.model.forward(q).tip_m) for q in (start, end))
        tips = [Target(tip_m=place) for place in places]
        command: Actuation = config.model.inverse(config.frame.target_in_base(tips[0]), start).actuation
        goal = config.model.inverse(config.frame.target_in_base(tips[1]), command).actuation
        together = motion_to(config, command, PresentRates.at_rest(len(goal)), goal)
        line = tip_line(config, tips[0], tips[1], command)
        found.append((line, together.duration_s))
    return found


def test_a_redundant_arm_whose_answers_jump_takes_no_line_of_a_minute() -> None:
    (config,) = build_robot_configs(load_named("trirack2"), 200.0)
    lines = [(line.duration_s, axes_s) for line, axes_s in jumps(config, 20) if line is not None]
    assert len(lines) >= 5
    assert all(line_s <= 5.0 * axes_s for line_s, axes_s in lines)
    before = [line.duration_s for line, _ in jumps(replace(config, motion_rules=7), 20) if line is not None]
    assert max(before) > 30.0
    assert len(before) > len(lines)


def test_a_finger_keeps_nearly_all_of_its_lines() -> None:
    (config,) = build_robot_configs(load_named("finger"), 200.0)
    assert sum(line is None for line, _ in jumps(config, 20)) <= 2
