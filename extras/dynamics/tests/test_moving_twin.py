"""`sim: {dynamics: true}`: the simulated bus carries a body that swings, and its tracker sees it."""

from __future__ import annotations

import io

import numpy as np
import pytest

from contid.control.engine.virtual import run_virtual
from contid.errors import ContidError
from contid.kinematics.array import Array
from contid.robot_file.load import LoadedFile, load_named, parse_robot_file, with_mock
from contid.trajectory.read import read_trajectory
from contid_dynamics.report import pose_modes
from tests.support.fingers import Collector

#: One pressure goes up in 0.4 s, and stays.
STEP = (
    "t_s,s1.p1_bar,s1.p2_bar,s1.p3_bar,s2.p1_bar,s2.p2_bar,s2.p3_bar\n"
    "0,0.2,0,0,0,0,0\n0.4,0.5,0,0,0,0,0\n4,0.5,0,0,0,0,0\n"
)
SHORT = STEP.replace("\n4,", "\n1,")
BENT_PA = (0.5e5, 0.0, 0.0, 0.0, 0.0, 0.0)
SIM = "sim: {dynamics: true, tracker: {noise_mm: 0, rate_hz: 100, latency_ms: 0}}"


def moving(name: str, **replaced: str) -> LoadedFile:
    text = load_named(name).text.replace("    rates:", f"    {SIM}\n    rates:", 1)
    for old, new in replaced.items():
        text = text.replace(f"{old}: ", f"{old}: {new}  # ", 1)
    return with_mock(parse_robot_file(text, f"{name}.yaml"))


def run_of(loaded: LoadedFile, rows: str, rate_hz: float) -> tuple[Array, Array]:
    """Times of the ticks [s], and the measured tips [m]."""
    seen = Collector(loaded)
    trajectory = read_trajectory(io.StringIO(rows), "rows.csv", loaded.driven)
    assert run_virtual(loaded, rate_hz, trajectory, sinks=[seen]).exit_code == 0
    tips = np.array([record.robots[0].measured_tip_m for record in seen.records])
    return np.arange(len(tips)) / rate_hz, tips


def swing(tips: Array) -> Array:
    """Distance along the main direction about the mean."""
    about = tips - tips.mean(axis=0)
    along: Array = about @ np.linalg.svd(about, full_matrices=False)[2][0]
    return along


def test_the_tip_swings_after_a_move_as_its_mode_does() -> None:
    loaded = moving("stiffflop2")
    time_s, tips = run_of(loaded, STEP, 200.0)
    late = (time_s > 1.2) & (time_s < 4.0)
    along, at_s = swing(tips[late]), time_s[late]
    assert np.ptp(along) > 2e-3
    (robot,) = loaded.driven.values()
    first, second, *_ = pose_modes(robot, BENT_PA, 2).modes
    crossings = at_s[:-1][np.diff(np.sign(along)) != 0]
    found_hz = (len(crossings) - 1) / (2.0 * (crossings[-1] - crossings[0]))
    assert min(abs(found_hz / mode.frequency_hz - 1.0) for mode in (first, second)) < 0.05


def test_a_run_in_virtual_time_is_the_same_to_the_bit() -> None:
    runs = [run_of(moving("stiffflop2"), SHORT, 200.0)[1] for _ in range(2)]
    assert np.array_equal(runs[0], runs[1], equal_nan=True)


def test_the_dead_time_of_the_actuators_comes_before_the_body() -> None:
    moved = []
    for delay_ms in (0, 150):
        loaded = moving("stiffflop2", damping_ms=f"8\n      delay_ms: [{delay_ms}]")
        time_s, tips = run_of(loaded, SHORT, 200.0)
        moved.append(float(time_s[np.flatnonzero(tips[:, 0] < -0.02)[0]]))
    assert moved[1] - moved[0] == pytest.approx(0.15, abs=0.011)


def test_a_tendon_robot_comes_to_rest_at_the_pose_of_its_model() -> None:
    loaded = moving("tendon3")
    rows = "t_s,x_mm,y_mm,z_mm,ax,ay,az\n0,0,0,315,0,0,1\n2,40,10,305,0.3,0,1\n6,40,10,305,0.3,0,1\n"
    _, tips = run_of(loaded, rows, 100.0)
    assert np.linalg.norm(tips[-1] - [0.040, 0.010, 0.305]) < 1e-3
    assert np.ptp(tips[:, 0]) > 0.03


def rest_of(loaded: LoadedFile) -> float:
    """Greatest distance of the tip from its rest after the devices have stopped [m]."""
    seen = Collector(loaded)
    trajectory = read_trajectory(io.StringIO(STEP), "rows.csv", loaded.driven)
    assert run_virtual(loaded, 200.0, trajectory, sinks=[seen]).exit_code == 0
    tips = np.array([record.robots[0].measured_tip_m for record in seen.records])
    device = np.array([record.robots[0].axes[0].device for record in seen.records])
    moves = np.flatnonzero(np.abs(np.diff(device[:700])) > 1.0)
    return float(
        np.linalg.norm(tips[moves[-1] + 4 : moves[-1] + 250] - tips[700:].mean(axis=0), axis=1).max()
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "wrong",
    [
        ((1.0, 0.1), (1.2, 0.25)),
        pytest.param(((1.0, 0.1), (0.8, 0.25), (1.2, 0.25)), marks=pytest.mark.campaign),
    ],
)
def test_shaped_commands_leave_a_tenth_of_the_swing_and_a_quarter_at_another_frequency(
    wrong: tuple[tuple[float, float], ...],
) -> None:
    """Factors of the frequency, each with the share of the swing that may be left."""
    (robot,) = load_named("stiffflop2").driven.values()
    first = pose_modes(robot, BENT_PA, 1).modes[0]
    free = rest_of(moving("stiffflop2"))
    assert free > 5e-3
    for off, most in wrong:
        shape = f"{{frequency_hz: {off * first.frequency_hz:.4f}, damping_ratio: {first.ratio:.4f}}}"
        loaded = moving("stiffflop2", jerk_bar_s3=f"400\n      shape: {shape}")
        assert rest_of(loaded) < most * free


def test_a_wall_in_motion_and_missing_masses_are_refused() -> None:
    text = load_named("stiffflop2").text
    wall = "sim: {dynamics: true, wall: {point_mm: [0, 0, 90], normal: [0, 0, -1]}}"
    with pytest.raises(ContidError, match="an arm in motion has no wall"):
        parse_robot_file(text.replace("    rates:", f"    {wall}\n    rates:", 1), "arm.yaml")
    begin, end = text.index("    dynamics:"), text.index("    placeholder:")
    without = text[:begin] + f"    {SIM}\n" + text[end:]
    with pytest.raises(ContidError, match=r"sim\.dynamics needs dynamics"):
        parse_robot_file(without, "arm.yaml")
