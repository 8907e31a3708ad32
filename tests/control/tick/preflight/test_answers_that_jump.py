"""A pneumatic arm near zero pressure: the nearest answer to the centre jumps, the command does not.

Of all pressures for a tip the model gives the locally nearest to the centre. Near the straight, empty arm
such an answer ends where an axis meets 0 bar, and the next one is elsewhere. The command goes there within
its limits while the tip stays on its line; where it cannot, no command could (an optimiser of its own looks).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pytest
from scipy.optimize import least_squares

from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.limits import allowed_steps
from contid.control.tick.next_command import next_command, tip_tolerance_m
from contid.kinematics.array import Array
from contid.robot_file.base import Quantity
from contid.robot_file.load import load_named
from contid.targets import Actuation, Target, vec3
from contid.units import BAR
from tests.support.robot_configs import SLACK

RATE_HZ = 500.0
(CONFIG,) = build_robot_configs(load_named("stiffflop2"), RATE_HZ)
TOLERANCE_M = tip_tolerance_m(Quantity.PRESSURE)


class Followed(NamedTuple):
    """Ticks whose answer jumped, distances of late tips [m], and the least that the limits allowed there."""

    jumps: int
    late_m: list[float]
    least_m: list[float]


def line(rng: np.random.Generator, most_bar: float, speed_m_s: float) -> Array:
    """Tips of every tick along a line between two random poses, from rest to rest, shape ``(n, 3)`` [m]."""
    begin, end = (
        np.array(CONFIG.model.forward(tuple((BAR * rng.uniform(0.0, most_bar, 6)).tolist())).tip_m)
        for _ in range(2)
    )
    part = np.linspace(0.0, 1.0, max(50, int(math.dist(begin, end) / speed_m_s * RATE_HZ)) + 1)
    tips: Array = begin + (part**3 * (10.0 - 15.0 * part + 6.0 * part**2))[:, None] * (end - begin)
    return tips


def least_off(low: Array, high: Array, start: Array, tip: Array) -> float:
    """The least distance of a tip from its target [m] with commands from ``low`` to ``high``."""
    width = np.maximum(high - low, 1.0)

    def off_mm(share: Array) -> Array:
        reached = CONFIG.model.forward(tuple((low + share * width).tolist())).tip_m
        return 1e3 * (np.array(reached) - tip)

    begin = np.clip((start - low) / width, 1e-6, 1.0 - 1e-6)
    exact = {"xtol": 1e-12, "ftol": 1e-12, "gtol": 1e-12, "diff_step": 1e-4}
    found = least_squares(off_mm, begin, bounds=(0.0, 1.0), **exact)
    return 1e-3 * float(np.linalg.norm(found.fun))


def followed(tips: Array) -> Followed:
    """Every tick along tips, as a robot takes them; the limits of the axes hold in each."""
    model, limits = CONFIG.model, CONFIG.limits
    command = goal = model.inverse(Target(tip_m=vec3(tips[0].tolist())), tuple(model.lower)).actuation
    steps: Actuation = (0.0,) * 6
    straight, jumps = False, 0
    late_m, least_m = list[float](), list[float]()
    for tip in tips[1:]:
        target = Target(tip_m=vec3(tip.tolist()))
        answer = model.inverse(target, command)
        pace = [new - old for new, old in zip(answer.actuation, goal, strict=True)]
        jumps += any(abs(each) > 5.0 * limit.step for each, limit in zip(pace, limits, strict=True))
        last, goal = command, answer.actuation
        command, _, straight = next_command(CONFIG, last, steps, goal, pace, target, straight)
        ends = [allowed_steps(*at) for at in zip(limits, last, steps, strict=True)]
        low, high = np.array(last) + np.array(ends).T
        before, steps = steps, tuple([new - old for new, old in zip(command, last, strict=True)])
        for limit, new, old in zip(limits, steps, before, strict=True):
            assert abs(new) <= limit.step * SLACK
            assert abs(new - old) <= limit.change * SLACK
        off_m = math.dist(model.forward(command).tip_m, tip)
        if answer.converged and off_m > TOLERANCE_M:
            late_m.append(off_m)
            least_m.append(least_off(low, high, np.array(command), tip))
    return Followed(jumps, late_m, least_m)


def test_the_tip_stays_on_its_line_while_the_answer_jumps() -> None:
    rng, jumps = np.random.default_rng(1), 0
    for _ in range(3):
        found = followed(line(rng, 0.3, 0.01))
        jumps += found.jumps
        assert not found.late_m
    assert jumps > 0


@pytest.mark.parametrize("number", [pytest.param(23, marks=pytest.mark.campaign), 27])
def test_a_late_tip_is_about_as_near_as_the_limits_allow(number: int) -> None:
    """Lines to the empty arm at 2 mm/s: an axis at 0 bar turns the answers, and axes need time to turn."""
    rng = np.random.default_rng(1)
    tips = [line(rng, 0.1, 0.002) for _ in range(number + 1)][number]
    found = followed(tips)
    assert found.late_m
    assert max(found.late_m) < 1e-3
    assert (np.array(found.least_m) > 0.5 * np.array(found.late_m)).all()
    assert max(found.least_m) > 0.8 * max(found.late_m)
