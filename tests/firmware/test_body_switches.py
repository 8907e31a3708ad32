"""Mechanical faults of emulated boards: what the body does while the board reads something else."""

from __future__ import annotations

import pytest

from contid_drivers.due.codes import BoardState
from contid_emulate.due import BoardFault

pytestmark = pytest.mark.process


def switch(board, **keys):
    board.command(BoardFault.model_validate(keys).command)


def stream(board, speed, ms):
    """Demands [counts or Pa] on a line from where the channel is, every 10 ms; the newest report."""
    zero = board.demand().channels[0].position
    for k in range(ms // 10):
        goal = round(zero + speed * 0.01 * k)
        report = board.demand({0: goal}, velocities={0: round(speed)}).channels[0]
        board.step(10)
    return report


def test_an_encoder_that_sees_half_of_the_motion_lets_the_shaft_go_twice_as_far(board):
    motors = board("motor")
    motors.configure({"m0": {}})
    motors.arm(0)
    switch(motors, fault="encoder_share", channel=0, value=0.5)
    report = stream(motors, 1000.0, 1000)
    assert report.state is BoardState.ARMED
    assert report.position == pytest.approx(990, abs=30)
    assert motors.truth(0)[0] == pytest.approx(2 * report.position, abs=60)


def test_an_encoder_that_jumps_is_driven_back_by_the_shaft(board):
    motors = board("motor")
    motors.configure({"m0": {}})
    motors.arm(0)
    switch(motors, fault="encoder_jump", channel=0, value=300.0)
    motors.step(5)
    assert motors.demand().channels[0].position == pytest.approx(300, abs=60)
    for _ in range(50):
        motors.demand()  # feeds the watchdog
        motors.step(10)
    assert motors.demand().channels[0].position == pytest.approx(0, abs=10)
    assert motors.truth(0)[0] == pytest.approx(-300, abs=10)


def test_a_stuck_valve_keeps_the_pressure(board):
    regulators = board("pressure")
    regulators.configure({"p0": {}})
    regulators.arm(0)
    stream(regulators, 50_000.0, 1000)
    before = regulators.truth(0)[2]
    switch(regulators, fault="valve_stuck", channel=0)
    report = stream(regulators, 50_000.0, 300)
    assert regulators.truth(0)[2] == pytest.approx(before, abs=1.0)
    assert report.position == pytest.approx(before, abs=500.0)
    assert before > 40_000.0
