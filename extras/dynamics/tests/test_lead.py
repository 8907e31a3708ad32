"""Commands that lead a path: the inverse of the answer in closed form, and the tip of the moving twin."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Final

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.optimize import minimize
from scipy.signal import lsim

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid.kinematics.model import build_model
from contid.kinematics.tendon.model import TendonModel
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.load import load_named, parse_robot_file
from contid.targets import Target
from contid_dynamics.arm import MovingArm
from contid_dynamics.body import MovingBody
from contid_dynamics.coordinates import Bends, coordinates_of, held
from contid_dynamics.lead import Answer, answer_of, check_velocities, eased, led
from contid_dynamics.lead_command import command
from contid_dynamics.lead_file import led_commands, rows_text

TICK_S: Final = 0.005


def round_trip(seconds: float, turn_s: float) -> Array:
    """A share 0 to 1 that begins and ends at rest, with its derivatives, and turns on the way."""
    t = np.arange(0.0, seconds + 1e-9, TICK_S, dtype=np.float64)
    s = np.clip(np.minimum(t, seconds - t) / 1.5, 0.0, 1.0)
    ease = s**4 * (35.0 - 84.0 * s + 70.0 * s**2 - 20.0 * s**3)
    wave: Array = ease * (0.5 - 0.5 * np.cos(2.0 * np.pi * t / turn_s))
    return wave


def test_what_comes_out_of_the_answer_is_the_path() -> None:
    """The answer is integrated by another library, as a transfer function of order three."""
    path, lag_s, hz, ratio = round_trip(6.0, 2.0), 0.12, 2.3, 0.2
    command = led(path[:, None], TICK_S, Answer((0.0,), (lag_s,), hz, ratio))[:, 0]
    rate = 2.0 * math.pi * hz
    parts = np.polymul([lag_s, 1.0], [1.0 / rate**2, 2.0 * ratio / rate, 1.0])
    times = TICK_S * np.arange(len(command), dtype=np.float64)
    reached = lsim(([1.0], parts), command, times)[1]
    without = lsim(([1.0], parts), path, times)[1]
    assert np.abs(reached - path).max() < 2e-3
    assert np.abs(without - path).max() > 0.2


def test_a_file_is_led_through_its_rows(tmp_path: Path) -> None:
    """At 20 ms a row; the answer to what is written comes through the rows, later by the dead time."""
    text = load_named("stiffflop1").text
    (tmp_path / "arm.yaml").write_text(
        text.replace("damping_ms: 8", "damping_ms: 8\n      delay_ms: [30]\n      lag_ms: [100]", 1)
    )
    wave = round_trip(5.0, 2.5)[::4]
    rows = [f"{0.02 * k:.2f},{0.2 + 0.3 * each:.9f},0.2,0.2" for k, each in enumerate(wave.tolist())]
    (tmp_path / "path.csv").write_text("\n".join(("t_s,s1.p1_bar,s1.p2_bar,s1.p3_bar", *rows)) + "\n")
    arguments = [str(tmp_path / "arm.yaml"), str(tmp_path / "path.csv"), "-o", str(tmp_path / "led.csv")]
    done = CliRunner().invoke(command, [*arguments, "--no-body"])
    assert done.exit_code == 0, done.output
    assert "the tip does the path 30 ms later" in done.output
    led_rows = np.loadtxt(tmp_path / "led.csv", delimiter=",", skiprows=1)
    reached = lsim(([1.0], [0.1, 1.0]), led_rows[:, 1] - led_rows[0, 1], led_rows[:, 0])[1] + led_rows[0, 1]
    at_rows = np.interp(0.02 * np.arange(len(wave), dtype=np.float64), led_rows[:, 0], reached)
    assert np.abs(at_rows - (0.2 + 0.3 * wave)).max() < 1e-3
    text = (tmp_path / "arm.yaml").read_text()
    shaped = "    rates:\n      shape: {frequency_hz: 5}\n"
    (tmp_path / "arm.yaml").write_text(text.replace("    rates:\n", shaped, 1))
    refused = CliRunner().invoke(command, arguments)
    assert "rates.shape delays what a lead has made up for" in str(refused.exception)


def test_a_body_that_creeps_back_is_led_too() -> None:
    """Above critical damping the damped frequency is 0; the answer has the undamped one."""
    text = load_named("tendon3").text
    creeping = parse_robot_file(re.sub(r"damping_ms: [0-9.]+", "damping_ms: 400", text), "arm.yaml")
    usual, slow = (answer_of(each.driven["arm"], (0.0,) * 9) for each in (load_named("tendon3"), creeping))
    assert slow.frequency_hz == pytest.approx(usual.frequency_hz)
    assert slow.ratio > 1.0


def test_times_of_a_long_path_keep_their_ticks() -> None:
    text = rows_text(("t_s", "p_bar"), np.zeros((2, 1)), first_tick=500_001, period_s=0.002)
    assert text.splitlines()[1:] == ["1000.002,0", "1000.004,0"]


def test_a_path_that_is_no_text_is_refused_by_its_column(tmp_path: Path) -> None:
    (tmp_path / "path.csv").write_bytes(b"\xff\xfe\x00")
    arguments = ["tendon3", str(tmp_path / "path.csv"), "-o", str(tmp_path / "led.csv")]
    done = CliRunner().invoke(command, arguments)
    assert "unknown column" in str(done.exception)


def test_axes_with_a_shorter_dead_time_wait() -> None:
    path = np.column_stack((round_trip(4.0, 2.0),) * 2)
    command = led(path, TICK_S, Answer((0.02, 0.10), (0.0, 0.0)))
    assert len(command) == len(path) + 16
    assert command[16:, 0] == pytest.approx(path[:, 0], abs=1e-9)
    assert command[: len(path), 1] == pytest.approx(path[:, 1], abs=1e-9)


def twin(mass: float, payload_g: float = 0.0) -> Cosserat:
    """`stiffflop2` with slow regulators and dead times, other ones of the second section."""
    text = load_named("stiffflop2").text.replace("[133]", f"[{133 * mass:g}]", 1)
    sim = f"    sim: {{dynamics: true, payload_g: {payload_g:g}}}\n    rates:\n"
    text = text.replace(
        "damping_ms: 8",
        "damping_ms: 8\n      delay_ms: [120, 120, 120, 40, 40, 40]\n"
        "      lag_ms: [90, 90, 90, 250, 250, 250]",
        1,
    )
    (robot,) = parse_robot_file(text.replace("    rates:\n", sim, 1), "arm.yaml").driven.values()
    assert isinstance(robot, Cosserat)
    return robot


def pressures(wave: Array) -> Array:
    """Two sections that bend one after the other [Pa]."""
    out = np.zeros((len(wave), 6))
    out[:, 0], out[:, 4], out[:, 1] = 2e4 + 6e4 * wave, 2e4 + 4e4 * wave, 2e4
    return out


def error_mm(robot: Cosserat, path: Array, commands: Array) -> tuple[float, float]:
    """RMS distance of the tip from the path: at the file's times, and at the times that suit it best."""
    body, still = MovingBody(robot), MovingArm(twin(1.0))
    held = np.vstack((commands, np.repeat(commands[-1:], 160, axis=0)))
    tips = []
    for tick, row in enumerate(held.tolist()):
        body.follow(row, tick * TICK_S)
        tips.append(body.tip_in_world_m(tick * TICK_S))
    asked = []
    for row in path[::10].tolist():
        still.settle(row, steps=2)
        asked.append(still.tip_m)
    found, wish = np.array(tips), np.array(asked)
    shifts = [
        1e3 * float(np.sqrt(np.mean(np.sum((found[s : s + len(path) : 10] - wish) ** 2, axis=1))))
        for s in range(160)
    ]
    return shifts[24], min(shifts)


def test_the_tip_does_the_path_of_the_file() -> None:
    """On a plant whose first frequency is 10 % lower; 24 ticks are the greatest dead time."""
    robot, path = twin(1.0), pressures(round_trip(5.0, 2.5))
    answer = answer_of(robot, path.mean(axis=0).tolist())
    times_s = TICK_S * np.arange(len(path), dtype=np.float64)
    commands = led_commands(robot, build_model(robot), path, times_s, TICK_S, answer, ease_s=0.5).commands
    plant = twin(1.0 / 0.81)
    plain, best = error_mm(plant, path, path)
    ahead, _ = error_mm(plant, path, commands)
    print(f"plain {plain:.2f}, plain at the best time {best:.2f}, led {ahead:.2f} mm")
    assert plain > 5.0
    assert ahead < 0.25 * plain
    assert ahead < 0.5 * best


def test_axes_that_are_too_slow_are_named() -> None:
    robot = twin(1.0)
    path = pressures(np.r_[np.zeros(10), np.ones(60)])
    with pytest.raises(ContidError, match=r"arm\.s1\.p1 moves at .* allowed: 2; make the path slower"):
        check_velocities(robot, "arm", path, TICK_S)
    with pytest.raises(ContidError, match="at least 6 are needed"):
        led(path[:4], TICK_S, Answer((0.0,) * 6, (0.1,) * 6))


def test_a_path_sets_out_and_stops_where_it_is_not_at_rest() -> None:
    """A circle: through the same places, slower at its ends only; a path at rest stays as it is."""
    turn = np.linspace(0.0, 2.0 * np.pi, 101)
    circle = np.column_stack((np.cos(turn), np.sin(turn)))
    found = eased(circle, np.linspace(0.0, 4.0, 101), TICK_S, 0.6)
    assert len(found) == 1 + round(4.6 / TICK_S)
    assert np.abs(np.hypot(*found.T) - 1.0).max() < 1e-6
    pace = np.linalg.norm(np.diff(found, axis=0), axis=1) / TICK_S
    assert pace[0] < 1e-4
    assert pace[-1] < 1e-4
    assert pace[120:-120] == pytest.approx(0.5 * np.pi, rel=1e-4)
    still = round_trip(4.0, 2.0)[:, None]
    assert eased(still, TICK_S * np.arange(len(still), dtype=np.float64), TICK_S, 0.6) == pytest.approx(
        still, abs=1e-9
    )


def test_held_pressures_move_the_tip_least() -> None:
    """Beside another method of optimisation: no change within the limits moves the tip less."""
    robot = twin(1.0)
    model = build_model(robot)
    coordinates = coordinates_of(robot, model, 1.0)
    path = np.array([[2e4, 5e4, 1e4, 3e4, 4e4, 8e4]])
    wished = path + np.array([[-4e4, 2e4, -1.5e4, 0.0, 1e4, 9e4]])
    found = held(coordinates, path, wished)
    assert found.ticks == 1
    change = found.rows[0] - wished[0]
    slope = model.jacobian(tuple(path[0].tolist()))
    still = 0.05 * np.linalg.norm(slope, 2)
    scale = 1e5

    def cost(share: Array) -> float:
        return float(np.sum((slope @ share * scale) ** 2) + np.sum((still * scale * share) ** 2)) * 1e6

    low, high = (np.array(each) for each in (model.lower, model.upper))
    bounds = list(zip((low - wished[0]) / scale, (high - wished[0]) / scale, strict=True))
    other = minimize(cost, np.zeros(6), bounds=bounds, method="L-BFGS-B", options={"ftol": 1e-14})
    assert cost(change / scale) == pytest.approx(float(other.fun), rel=1e-4)
    assert change / scale == pytest.approx(other.x, abs=2e-3)
    assert np.all(coordinates.actuations(found.rows) >= 0.0)


def test_led_tendons_stay_taut_and_bend_as_led() -> None:
    """The tensions are those of the model; the bends those of a lead without limits."""
    (robot,) = load_named("tendon3").driven.values()
    model = build_model(robot)
    assert isinstance(model, TendonModel)
    turn = np.linspace(0.0, 2.0 * np.pi, 61)
    arcs = [
        (0.9 + 0.3 * np.sin(t), 0.4 * np.cos(t), 0.1, -0.5, 0.3, 0.0, 0.6, 0.2 * np.sin(t), 0.1) for t in turn
    ]
    path = np.array([model.of_arcs(row, robot.rest) for row in arcs])
    answer = Answer((0.0,) * 9, (0.08,) * 9, 6.0, 0.05)
    made = led_commands(robot, model, path, 0.05 * np.arange(61, dtype=np.float64), 0.01, answer, ease_s=0.5)
    assert made.held == 0
    for row in made.commands.tolist():
        tensions = model.tensions(tuple(row))
        assert tensions is not None
        assert min(tensions) > 1.0 - 1e-6
    bends = Bends(model)
    wished = led(bends.of(made.path), 0.01, Answer((0.0,) * 6, (0.08,) * 6, 6.0, 0.05))
    assert bends.of(made.commands) == pytest.approx(wished, abs=1e-9)
    assert np.abs(made.commands - made.path).max() > 5e-4


def test_free_axes_of_a_tip_path_turn_no_corners() -> None:
    """A circle whose answers row by row touch both limits and jump: the tip does it, off the limits."""
    robot = twin(1.0)
    model = build_model(robot)
    turn = np.linspace(0.0, 2.0 * np.pi, 61)
    seed, rows = robot.rest, []
    for t in turn.tolist():
        found = model.inverse(Target(tip_m=(0.02225 * math.cos(t), 0.02225 * math.sin(t), 0.089)), seed)
        seed = found.actuation
        rows.append(seed)
    path = np.array(rows)
    assert np.abs(np.diff(path, axis=0)).max() > 1e4
    answer = Answer((0.0,) * 6, (0.1,) * 6, 2.0, 0.05)
    made = led_commands(
        robot, model, path, 0.1 * np.arange(61, dtype=np.float64), 0.02, answer, ease_s=0.8, by_tips=True
    )
    tips = np.array([model.forward(tuple(row)).tip_m for row in made.path[::4].tolist()])
    assert np.abs(np.hypot(tips[:, 0], tips[:, 1]) - 0.02225).max() < 1e-4
    assert np.abs(tips[:, 2] - 0.089).max() < 1e-4
    assert np.abs(np.diff(made.commands, axis=0)).max() < 0.02 * 2e5 * (1.0 + 1e-9)
    assert made.held < 0.05 * len(made.commands)
