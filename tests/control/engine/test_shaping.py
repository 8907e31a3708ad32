"""Input shaping: a swing cancels, limits hold, and what goes out ends at the command."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence

import numpy as np
import pytest

from contid.control.engine.virtual import run_virtual
from contid.control.tick.shaping import NOT_SHAPED, Shaper, next_shaped
from contid.errors import ContidError
from contid.kinematics.array import Array
from contid.robot_file.load import load_named, parse_robot_file, with_mock
from contid.robot_file.rates import InputShape, ShapeKind
from contid.trajectory.read import read_trajectory
from tests.support.fingers import Collector

PERIOD_S, HZ, RATIO = 0.005, 2.3, 0.06


def shaper(kind: str, frequency_hz: float = HZ, damping_ratio: float = RATIO) -> Shaper:
    shape = InputShape(kind=ShapeKind(kind), frequency_hz=frequency_hz, damping_ratio=damping_ratio)
    return Shaper.of(shape, PERIOD_S)


def shaped(one: Shaper, commands: Sequence[float] | Array) -> Array:
    state, last, out = NOT_SHAPED, (commands[0],), []
    for value in commands:
        state = next_shaped(lambda goal, load: one, state, last, (value,), (value,))
        last = (value,)
        out.append(state.acting[0])
    return np.array(out)


def residual(inputs: Array) -> float:
    """Swing of an oscillator of `HZ` (damped) and `RATIO` after its input has come to rest; in closed form.

    Each change of the input is a step, whose answer is ``1 - exp(-z w t) (cos wd t + z w / wd sin wd t)``.
    """
    damped = 2.0 * math.pi * HZ
    rate = RATIO / math.sqrt(1.0 - RATIO**2) * damped
    steps = np.flatnonzero(np.diff(inputs))
    t = (np.arange(len(inputs), len(inputs) + 400)[:, None] - steps[None, :] - 1) * PERIOD_S
    swings = np.exp(-rate * t) * (np.cos(damped * t) + rate / damped * np.sin(damped * t))
    swing: Array = swings @ np.diff(inputs)[steps]
    return float(np.abs(swing).max())


@pytest.mark.parametrize(
    ("kind", "off", "most"),
    [
        ("zv", 1.0, 0.01),
        ("zvd", 1.0, 0.005),
        ("zv", 1.2, 0.3),
        ("zvd", 1.2, 0.1),
        ("zv", 0.8, 0.3),
        ("zvd", 0.8, 0.15),
    ],
)
def test_the_swing_after_a_step_is_cancelled(kind: str, off: float, most: float) -> None:
    step = np.concatenate((np.zeros(5), np.ones(110)))
    assert residual(step) > 0.5
    assert residual(shaped(shaper(kind, HZ * off), step)) < most


@pytest.mark.parametrize("kind", ["zv", "zvd"])
def test_no_rate_grows(kind: str) -> None:
    """Rates of what goes out are weighted means of those of the commands."""
    rng = np.random.default_rng(3)
    for _ in range(20):
        knots = rng.normal(size=12)
        commands = np.interp(np.arange(600), np.linspace(0, 400, 12), knots)
        commands = np.convolve(commands, np.ones(9) / 9, mode="same")
        out = shaped(shaper(kind, rng.uniform(0.7, 12.0), rng.uniform(0.0, 0.5)), commands)
        assert commands.min() - 1e-12 <= out.min()
        assert out.max() <= commands.max() + 1e-12
        for order in (1, 2, 3):
            bound = np.abs(np.diff(np.concatenate(([commands[0]] * 3, commands)), order)).max()
            assert np.abs(np.diff(out, order)).max() <= bound + 1e-12


def test_what_goes_out_ends_exactly_at_the_command() -> None:
    out = shaped(shaper("zvd"), [0.0, 0.1, *[0.3] * 200])
    assert out[-1] == 0.3
    assert out[20] != 0.3


SHAPE = "      shape: {kind: zvd, frequency_hz: 2.2, damping_ratio: 0.05}\n"
ROWS = (
    "t_s,s1.p1_bar,s1.p2_bar,s1.p3_bar,s2.p1_bar,s2.p2_bar,s2.p3_bar\n"
    "0,0.2,0,0,0,0,0\n0.4,0.5,0,0,0,0,0\n0.8,0.3,0,0,0,0,0\n"
)


def test_devices_of_a_run_get_shaped_commands_and_arrive() -> None:
    text = load_named("stiffflop2").text
    loaded = with_mock(parse_robot_file(text.replace("    stop: {", SHAPE + "    stop: {", 1), "arm.yaml"))
    seen = Collector(loaded)
    run_virtual(loaded, 200.0, read_trajectory(io.StringIO(ROWS), "rows.csv", loaded.driven), sinks=[seen])
    assert not [event for event in seen.events if event["event"] == "fault"]
    command, device = np.array(
        [[r.robots[0].axes[0].command, r.robots[0].axes[0].device] for r in seen.records if r.robots[0].axes]
    ).T
    known = np.isfinite(command) & np.isfinite(device)
    command, device = command[known], device[known]
    assert np.abs(device - command).max() > 1e4
    assert device[-1] == command[-1]
    assert np.abs(np.diff(device)).max() <= 2.0e5 / 200.0 * (1 + 1e-9)


def test_a_wrong_frequency_is_located() -> None:
    text = load_named("stiffflop2").text
    wrong = SHAPE.replace("2.2", "0")
    with pytest.raises(
        ContidError, match=r"arm.yaml:\d+:\d+: frequency_hz: allowed is a number at least 0\.5"
    ):
        parse_robot_file(text.replace("    stop: {", wrong + "    stop: {", 1), "arm.yaml")


def test_shaped_robots_have_no_clearance() -> None:
    """The guard checks the commands, and devices on a mean of them would cut the corners of the way."""
    text = load_named("hand").text
    assert "clearance:" in text
    with pytest.raises(ContidError, match=r"shape: .* off the way that is checked for clearance"):
        parse_robot_file(
            text.replace("    rates:\n", "    rates:\n      shape: {frequency_hz: 4}\n", 1), "hand.yaml"
        )
