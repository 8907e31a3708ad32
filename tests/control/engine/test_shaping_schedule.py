"""Input shaping over poses and loads: polynomials, the choice when a motion begins, limits, replays."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from contid.control.engine import messages as msg
from contid.control.tick.shaping import NOT_SHAPED, ShaperChoice, next_shaped
from contid.errors import ContidError
from contid.kinematics.array import Array
from contid.robot_file.base import Quantity
from contid.robot_file.load import LoadedFile, load_named, parse_robot_file, with_mock
from contid.robot_file.rates import InputShape, ShapeSchedule
from contid.session.read import Session
from contid.targets import Target
from contid.units import STANDARD_GRAVITY
from contid_sessions.replay.replay import replay
from tests.session.runs import record_virtual

TICK_S = 0.005


def schedule(axes: int, seed: int = 1, **more: object) -> ShapeSchedule:
    rng = np.random.default_rng(seed)
    terms = 1 + axes + axes * (axes + 1) // 2
    first = [math.log(2.0), *rng.normal(0.0, 0.15, terms - 1).tolist()]
    second = [math.log(2.4), *rng.normal(0.0, 0.15, terms - 1).tolist()]
    return ShapeSchedule.model_validate(
        {"middle": [0.5] * axes, "half": [0.5] * axes, "least_hz": 1.0, "most_hz": 5.0}
        | {"first": first, "second": second}
        | more
    )


def shape(of: ShapeSchedule) -> InputShape:
    return InputShape(frequency_hz=2.0, damping_ratio=0.05, schedule=of)


def test_frequencies_are_the_polynomials_of_the_pose_held_within_the_range() -> None:
    found = schedule(2, least_hz=1.5, most_hz=3.0)
    rng = np.random.default_rng(2)
    for values in rng.uniform(-0.5, 1.5, (20, 2)):
        x = np.clip((values - 0.5) / 0.5, -1.0, 1.0)
        upper = np.outer(x, x)[np.triu_indices(2)]
        for hz, log in zip(found.frequencies(values.tolist()), (found.first, found.second), strict=True):
            assert hz == pytest.approx(np.clip(np.exp(np.dot(log, [1.0, *x, *upper])), 1.5, 3.0), rel=1e-12)


def test_squared_periods_grow_with_the_squares_of_bends() -> None:
    """A body of 4 Hz whose bends by 1 and 2 add 0.06 and 0.24 s2 to its squared period of 1/16 s2."""
    found = schedule(
        1, polynomials="squared_period", first=(0.0625, 0.0, 0.24), second=(0.01, 0.0, 0.0), middle=(0.0,),
        half=(2.0,), least_hz=1.9, most_hz=8.0,
    )  # fmt: skip
    assert found.frequencies([0.0]) == pytest.approx((4.0, 8.0))
    assert found.frequencies([-1.0])[0] == pytest.approx((0.0625 + 0.06) ** -0.5)
    assert found.frequencies([2.0])[0] == 1.9  # of 1.82
    assert found.model_copy(update={"first": (-1.0, 0.0, 0.0)}).frequencies([0.0])[0] == 8.0
    stiffer = found.scaled(1.25)
    assert stiffer.frequencies([1.0])[0] == pytest.approx(1.25 * (0.0625 + 0.06) ** -0.5)
    assert stiffer.frequencies([0.0])[1] == pytest.approx(10.0)


def test_a_mass_slows_as_one_on_a_spring() -> None:
    """With f0^2 / f^2 - 1 = 0.44 under 10 g the modal mass is 10 / 0.44 g."""
    loaded = schedule(1, first_loaded=(0.44, 0.0, 0.0), second_loaded=(0.0, 0.0, 0.0), load_g=10.0)
    (free, second), spring = loaded.frequencies([0.5]), 4.0 * math.pi**2 * (0.010 / 0.44) * 2.0**2
    assert free == pytest.approx(2.0)
    for mass_g in (2.0, 5.0, 10.0):
        first, other = loaded.frequencies([0.5], 1e-3 * mass_g * STANDARD_GRAVITY)
        alone = math.sqrt(spring / (0.010 / 0.44 + 1e-3 * mass_g)) / (2.0 * math.pi)
        assert first == pytest.approx(alone, rel=1e-9)
        assert other == second
    known = loaded.model_copy(update={"payload_g": 5.0})
    assert known.frequencies([0.5]) == loaded.frequencies([0.5], 5e-3 * STANDARD_GRAVITY)


def test_a_schedule_of_a_stiffer_body_is_scaled_as_a_whole() -> None:
    found = schedule(2)
    stiffer = found.scaled(1.25)
    for values in np.random.default_rng(3).random((10, 2)).tolist():
        both = zip(found.frequencies(values), stiffer.frequencies(values), strict=True)
        assert all(new == pytest.approx(1.25 * old, rel=1e-9) for old, new in both)


def test_the_parts_are_those_of_the_goal_and_stay_until_the_last_is_out() -> None:
    """Half a period of each of the two modes, and both after one another."""
    chosen = ShaperChoice.of(shape(of := schedule(2)), Quantity.PRESSURE, TICK_S)
    goal = (0.9e5, 0.2e5)
    first, second = of.frequencies([0.9, 0.2])
    state, last, out = NOT_SHAPED, (0.1e5, 0.1e5), []
    for tick in range(300):
        # After the first tick it turns to another goal, which has other frequencies.
        command, towards = (goal, goal) if tick == 0 else ((0.2e5, 0.2e5), (0.2e5, 0.9e5))
        state = next_shaped(chosen.shaper, state, last, command, towards)
        last = command
        out.append(state.acting[0])
    steps = np.flatnonzero(np.abs(np.diff(out)) > 1e-6)
    expected = {0}
    for after_s in (0.5 / first, 0.5 / second, 0.5 / first + 0.5 / second):
        floor = math.floor(after_s / TICK_S)
        expected |= {floor - 1, floor, floor + 1}
    assert set(steps.tolist()) <= expected
    assert out[-1] == 0.2e5


def test_limits_hold_over_motions_with_other_frequencies() -> None:
    """Rates of what goes out are weighted means of those of the commands, whatever is chosen when."""
    rng = np.random.default_rng(4)
    chosen = ShaperChoice.of(shape(schedule(2)), Quantity.PRESSURE, TICK_S)
    for _ in range(5):
        knots = np.repeat(rng.uniform(0.0, 1e5, (6, 2)), 2, axis=0)
        times = np.cumsum(rng.uniform(5.0, 400.0, 12))
        ticks = np.arange(int(times[-1]) + 300)
        commands = np.column_stack([np.interp(ticks, times, column) for column in knots.T])
        kernel = np.ones(9) / 9
        commands = np.column_stack([np.convolve(np.r_[[c[0]] * 8, c], kernel, "valid") for c in commands.T])
        state, last, out = NOT_SHAPED, tuple(commands[0].tolist()), []
        for row in commands.tolist():
            state = next_shaped(chosen.shaper, state, last, tuple(row), tuple(row))
            last = tuple(row)
            out.append(state.acting)
        _never_faster(commands, np.array(out))
        assert state.acting == last


def _never_faster(commands: Array, out: Array) -> None:
    assert (commands.min(axis=0) - 1e-6 <= out.min(axis=0)).all()
    assert (out.max(axis=0) <= commands.max(axis=0) + 1e-6).all()
    for order in (1, 2, 3):
        asked = np.diff(np.vstack((commands[:1],) * 3 + (commands,)), order, axis=0)
        gone = np.diff(np.vstack((out[:1],) * 3 + (out,)), order, axis=0)
        assert (np.abs(gone).max(axis=0) <= np.abs(asked).max(axis=0) + 1e-6).all()


def arm(of: ShapeSchedule) -> LoadedFile:
    text = load_named("stiffflop2").text
    parts = ", ".join(
        f"{key}: {list(value) if isinstance(value, tuple) else value}" for key, value in of if value != ()
    )
    written = f"      shape: {{frequency_hz: 2, damping_ratio: 0.05, schedule: {{{parts}}}}}\n"
    return with_mock(parse_robot_file(text.replace("    stop: {", written + "    stop: {", 1), "arm.yaml"))


def test_a_run_keeps_its_rates_and_replays_to_the_bit(tmp_path: Path) -> None:
    """Goals, a hold on the way, a stream and its end."""
    goals = [Target(actuation=tuple((1e5 * np.random.default_rng(k).random(6)).tolist())) for k in range(3)]
    orders: dict[int, list[msg.Message]] = {
        5: [msg.Goto("arm", goals[0])],
        260: [msg.Goto("arm", goals[1])],
        280: [msg.Hold()],
        500: [msg.Rows({"arm": goals[2]})],
        900: [msg.EndOfRows()],
    }
    path = record_virtual(tmp_path / "s.mcap", arm(schedule(6)), None, orders, ticks=1300)
    session = Session(path)
    result = replay(session, session.robot_file())
    assert (result.divergence, result.stopped, result.largest) == (None, "", 0.0)
    axes = [tick.robots[0].axes for tick in session.ticks()]
    device = np.array([[axis.device for axis in row] for row in axes])
    command = np.array([[axis.command for axis in row] for row in axes])
    known = np.isfinite(device).all(axis=1) & np.isfinite(command).all(axis=1)
    device, command = device[known], command[known]
    assert np.ptp(command, axis=0).max() > 5e4
    assert np.abs(device - command).max() > 1e4
    assert np.array_equal(device[-1], command[-1])
    for order, most in ((1, 2.0), (2, 20.0)):
        assert np.abs(np.diff(device, order, axis=0)).max() <= 1e5 * most * TICK_S**order * (1.0 + 1e-6)


def test_a_schedule_of_other_axes_is_located() -> None:
    with pytest.raises(ContidError, match=r"arm.yaml:\d+:\d+: schedule: it is for 3 axes, .* has 6; write"):
        arm(schedule(3))
    text = load_named("stiffflop2").text
    wrong = "      shape: {frequency_hz: 2, schedule: {middle: [0], half: [1], least_hz: 1, most_hz: 2, "
    wrong += "first: [0, 0], second: [0, 0, 0]}}\n"
    with pytest.raises(ContidError, match=r"first has 2 numbers; allowed: 3, for 1 axes"):
        parse_robot_file(text.replace("    stop: {", wrong + "    stop: {", 1), "arm.yaml")
