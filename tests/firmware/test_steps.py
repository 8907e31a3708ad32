"""Steps of the emulated segment and of the regulators: limits, overshoot, settling."""

import numpy as np
import pytest

pytestmark = pytest.mark.process

COUNTS_PER_MM = 60.80992066
TEN_CM_S = {"velocity_deg_s": 470.0, "acceleration_deg_s2": 2300.0}


def _step_response(board, goal_mm, seconds, **plant):
    motors = board("motor")
    motors.configure({"m0": TEN_CM_S})
    for name, value in plant.items():
        motors.command(f"set 0 {name} {value}")
    motors.arm(0)
    rows = []
    for _ in range(int(seconds * 200)):
        motors.demand({0: round(goal_mm * COUNTS_PER_MM)})
        motors.step(5)
        rows.append(motors.truth(0)[:2])
    assert motors.telemetry.channels[0].state.name == "ARMED"
    shaft, speed = np.array(rows).T / COUNTS_PER_MM
    return shaft, speed


# A plant as configured, and one whose speed, time constant and friction are each off by a third.
@pytest.mark.parametrize("plant", [{}, {"tau": 0.055}, {"friction": 0.08}, {"no_load": 7000.0}])
def test_step_of_100_mm(board, plant):
    shaft, speed = _step_response(board, 100.0, 2.5, **plant)
    limit_mm_s = 470.0 / 360.0 * 78.53981634
    assert shaft.max() <= 101.0
    assert np.abs(shaft[300:] - 100.0).max() <= 0.5  # settled within 1.5 s, for good
    if not plant:
        assert speed.max() <= limit_mm_s


def test_650_mm_is_39526_counts_and_back(board):
    shaft, _ = _step_response(board, 650.0, 8.0)
    assert round(650.0 * COUNTS_PER_MM) == 39526
    assert abs(shaft[-1] - 650.0) <= 0.5


def test_streamed_ramp_is_followed_without_steps(board):
    motors = board("motor")
    motors.configure({"m0": TEN_CM_S})
    motors.arm(0)
    errors, duties = [], []
    for i in range(400):
        goal_mm = 80.0 * i * 0.005
        motors.demand({0: round(goal_mm * COUNTS_PER_MM)})
        motors.step(5)
        errors.append(motors.truth(0)[0] / COUNTS_PER_MM - goal_mm)
        duties.append(motors.truth(0)[5])
    # Once up to speed: behind by no more than one demand interval and a little, at an even duty.
    assert np.abs(np.array(errors[200:])).max() < 1.0
    assert np.ptp(duties[200:]) < 0.15 * 32767


@pytest.mark.parametrize("trim_bar", [0.0, 0.1])
def test_step_of_1_5_bar(board, trim_bar):
    air = board("pressure")
    air.configure({"p0": {"slew_bar_s": 2.0, "trim_bar": trim_bar}})
    air.arm(0)
    pressures, commands = [], []
    for _ in range(400):
        air.demand({0: 150_000})
        air.step(5)
        pressures.append(air.truth(0)[2] / 1e5)
        commands.append(air.truth(0)[5] / 32767 * 3.0)
    assert np.diff(commands).max() / 0.005 <= 2.0 + (trim_bar * 2.0) + 0.05
    assert max(pressures) <= 1.53
    assert np.abs(np.array(pressures[240:]) - 1.5).max() <= 0.03  # 0.75 s of slew, settled by 1.2 s


def test_outer_loop_takes_out_a_calibration_error(board):
    air = board("pressure")
    air.configure({"p0": {"trim_bar": 0.2}})
    air.command("set 0 full_pa 285000")  # the regulator gives 5 % less than its table states
    air.arm(0)
    for _ in range(600):
        air.demand({0: 150_000})
        air.step(5)
    assert air.truth(0)[2] == pytest.approx(150_000, abs=3000)


def test_demands_end_at_the_ceiling(board):
    air = board("pressure")
    air.configure({"p0": {}})
    air.arm(0)
    for _ in range(400):
        air.demand({0: 290_000})
        air.step(5)
    assert air.truth(0)[2] <= 160_000 + 500
    assert air.telemetry.channels[0].limited
