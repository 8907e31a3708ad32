"""How much gain the tip feedback bears: a formula without delays, and simulations of the loop in time."""

from __future__ import annotations

import math
import re
from collections import deque
from pathlib import Path

import pytest
from click.testing import CliRunner

from contid.cli.main import cli
from contid.errors import ContidError
from contid.robot_file.load import load_named, parse_robot_file
from contid.robot_file.rates import Impulse, InputShape
from contid_dynamics.feedback_margin import feedback_line, highest_gain

STEP_S = 1e-3


def grows(
    gain: float,
    hz: float,
    ratio: float,
    parts: tuple[Impulse, ...] = (Impulse(0.0, 1.0),),
    *,
    delay_s: float = 0.0,
    lag_s: float = 0.0,
    late_s: float = 0.0,
) -> float:
    """How much greater the error is in the last fifth of 40 s than in the second: the loop step by step.

    The target is 0, the model off by 1 mm. Commands go through parts, dead time and lag; the body is a mass
    on a spring beside the axes; the filter runs towards its late tip less the model's tip of the axes now.
    """
    rate = 2.0 * math.pi * hz / math.sqrt(1.0 - ratio**2)
    longest = delay_s + parts[-1].after_s
    commands = deque([0.0] * (round(longest / STEP_S) + 1), maxlen=round(longest / STEP_S) + 1)
    tips = deque([0.0] * (round(late_s / STEP_S) + 1), maxlen=round(late_s / STEP_S) + 1)
    whole = sum(part.size for part in parts)
    axis = tip = speed = error = 0.0
    seen = []
    for _ in range(round(40.0 / STEP_S)):
        commands.append(-error)
        acting = sum(
            part.size / whole * commands[-1 - round((delay_s + part.after_s) / STEP_S)] for part in parts
        )
        axis += (acting - axis) * (-math.expm1(-STEP_S / lag_s) if lag_s else 1.0)
        speed += STEP_S * (rate**2 * (axis - tip) - 2.0 * ratio * rate * speed)
        tip += STEP_S * speed
        tips.append(tip)
        error += STEP_S * gain * (1e-3 + tips[0] - axis - error)
        seen.append(abs(error - 1e-3))
        if seen[-1] > 1e3:
            return math.inf
    fifth = len(seen) // 5
    return max(seen[-fifth:]) / max(max(seen[fifth : 2 * fifth]), 1e-12)


def test_without_delays_it_is_twice_the_damping() -> None:
    for hz, ratio in ((2.2, 0.055), (7.4, 0.01), (1.0, 0.3)):
        rate = 2.0 * math.pi * hz / math.sqrt(1.0 - ratio**2)
        assert highest_gain(hz, ratio) == pytest.approx(2.0 * ratio * rate, rel=1e-4)


@pytest.mark.parametrize(
    ("delay_s", "lag_s", "late_s"), [(0.04, 0.1, 0.0), (0.0, 0.05, 0.05), (0.1, 0.0, 0.02)]
)
def test_the_loop_in_time_grows_above_and_settles_below(delay_s: float, lag_s: float, late_s: float) -> None:
    least = highest_gain(2.2, 0.055, (), delay_s, lag_s, late_s)
    assert math.isfinite(least)
    below, above = (
        grows(k * least, 2.2, 0.055, delay_s=delay_s, lag_s=lag_s, late_s=late_s) for k in (0.9, 1.1)
    )
    assert below < 0.9
    assert above > 1.1


def test_shaped_commands_bear_more() -> None:
    parts = tuple(InputShape(frequency_hz=2.2, damping_ratio=0.055).impulses())
    assert highest_gain(2.2, 0.055, parts) > 15.0 * highest_gain(2.2, 0.055)
    assert grows(20.0, 2.2, 0.055) == math.inf
    assert grows(20.0, 2.2, 0.055, parts) < 0.1


def test_check_and_run_refuse_what_the_body_does_not_bear(tmp_path: Path) -> None:
    plain = load_named("stiffflop2")
    text = plain.text.replace("    rates:\n", "    feedback: {gain_per_s: 5}\n    rates:\n", 1)
    (robot,) = parse_robot_file(text, "arm.yaml").driven.values()
    with pytest.raises(ContidError, match="makes the body swing ever more, from") as refused:
        feedback_line(robot)
    (tmp_path / "arm.yaml").write_text(text)
    (tmp_path / "row.csv").write_text("t_s,x_mm,y_mm,z_mm\n0,0,0,110\n")
    for command in (("check",), ("run", "--mock", "--virtual", "--trajectory", str(tmp_path / "row.csv"))):
        result = CliRunner().invoke(cli, [command[0], str(tmp_path / "arm.yaml"), *command[1:]])
        assert isinstance(result.exception, ContidError)
        assert f"robots.arm.feedback: {refused.value}" in str(result.exception)
    (least,) = re.findall(r"from ([0-9.]+) on", str(refused.value))
    for gain, line in ((0.9 * float(least), "with frequencies 20 % off"), (0.3, "below instability")):
        (robot,) = parse_robot_file(
            text.replace("gain_per_s: 5", f"gain_per_s: {gain}"), "arm.yaml"
        ).driven.values()
        assert line in feedback_line(robot)
    (robot,) = plain.driven.values()
    assert feedback_line(robot) == ""
