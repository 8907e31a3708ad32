"""A device that trips because the loop stood still has the fault of the loop."""

from __future__ import annotations

import time
from dataclasses import replace

import pytest

from contid.control.engine.cycle import Timing
from contid.control.engine.robots import Robots
from contid.control.engine.stall_watch import StallWatch
from contid.control.engine.tick_costs import TickCosts
from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.faults import Fault
from contid.control.tick.robot_tick import TickResult
from contid.control.tick.state import RobotState
from contid.control.tick.supervisor import Mode
from tests.support.fingers import Collector, load

TRIP = "f0.left: watchdog tripped: no exchange for 200 ms"


def fault(starts_s: list[float], fault: Fault = Fault.DEVICE_FAULT, message: str = TRIP) -> RobotState:
    """The explained state of a robot that faults after ticks at given times."""
    config = replace(build_robot_configs(load(1), 200.0)[0], watchdog_s=0.2)
    robots = Robots([config], Collector(), TickCosts(time.monotonic, 1, ()))
    watch = StallWatch(robots, 200.0)
    for number, start_s in enumerate(starts_s):
        watch.before({}, Timing(number, 0, start_s, 0.0, start_s + 0.004), start_s)
    outcomes = [TickResult(RobotState(mode=Mode.FAULT, fault=fault, message=message))]
    watch.after(outcomes, {}, starts_s[-1])
    return outcomes[0].state


def test_a_trip_after_a_gap_is_the_loops() -> None:
    state = fault([0.0, 0.005, 1.005, 1.010])
    assert state.fault is Fault.LOOP_STALLED
    assert state.message == f"the loop stood still for 1000 ms: {TRIP}"
    # Of two gaps the longer one is named, until a second after it.
    assert "1000 ms" in fault([0.0, 1.0, 1.1, 1.105]).message


@pytest.mark.parametrize(
    ("starts_s", "which", "message"),
    [
        ([0.0, 0.005, 0.010, 0.015], Fault.DEVICE_FAULT, TRIP),
        ([0.0, 1.0, *(1.0 + 0.005 * tick for tick in range(1, 300))], Fault.DEVICE_FAULT, TRIP),
        ([0.0, 0.024, 0.029], Fault.DEVICE_FAULT, TRIP),
        ([0.0, 1.0], Fault.DEVICE_FAULT, "f0.left: overload"),
        ([0.0, 1.0], Fault.AXIS_SILENT, "f0.left did not answer; its watchdog stops it"),
    ],
    ids=["no gap", "long ago", "gap shorter than the watchdog", "another cause", "another fault"],
)
def test_other_faults_stay(starts_s: list[float], which: Fault, message: str) -> None:
    state = fault(starts_s, which, message)
    assert (state.fault, state.message) == (which, message)
