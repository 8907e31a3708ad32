"""The closing report: a run that ends by itself with its tip off target ends with a fault."""

from __future__ import annotations

import io
from dataclasses import replace

import pytest

from contid.control.engine.cycle import OnEnd
from contid.control.engine.messages import Begin
from contid.control.engine.virtual import run_virtual
from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.faults import Fault
from contid.control.tick.next_command import tip_tolerance_m
from contid.control.tick.preflight.rows import Preflight, Unreachable
from contid.control.tick.statistics import RobotTally
from contid.kinematics.rack.finger import RackFingerModel
from contid.robot_file.base import Quantity
from contid.robot_file.load import parse_robot_file
from contid.targets import Actuation, Solution, Target
from contid.trajectory.read import read_trajectory
from tests.support.fingers import Collector, circle, fingers, load

RATE = 200.0
#: Of runs that last long.
SLOW_RATE = 50.0
TOLERANCE_M = tip_tolerance_m(Quantity.LENGTH)


@pytest.fixture
def wrong_by_m(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> float:
    """A deliberate bug: both racks longer than the answer, with the residual of the answer."""
    off: float = request.param
    inverse = RackFingerModel.inverse

    def wrong(self: RackFingerModel, target: Target, seed: Actuation) -> Solution:
        right = inverse(self, target, seed)
        return replace(right, actuation=tuple(length + off for length in right.actuation))

    monkeypatch.setattr(RackFingerModel, "inverse", wrong)
    return off


@pytest.mark.parametrize("wrong_by_m", [3.0 * TOLERANCE_M], indirect=True)
def test_a_model_whose_residual_is_wrong_ends_the_run_with_a_fault(wrong_by_m: float) -> None:
    loaded = load(1)
    report = run_virtual(loaded, RATE, circle(loaded))
    assert report.exit_code == 3
    assert report.robots["f0"]["fault"] == Fault.TIP_OFF_TARGET
    assert "off its targets, the tolerance is 1e-06 mm" in report.robots["f0"]["message"]
    assert report.robots["f0"]["tip_error_max_mm"] > 1e3 * TOLERANCE_M


@pytest.mark.parametrize("wrong_by_m", [3.0 * TOLERANCE_M], indirect=True)
def test_a_stream_that_begins_while_the_run_ends_does_not_hide_it(wrong_by_m: float) -> None:
    loaded, collector = load(1), Collector()
    path, orders = circle(loaded), {335: [Begin()]}
    report = run_virtual(loaded, RATE, path, on_end=OnEnd.REST, sinks=[collector], orders=orders)
    (ended,) = [event for event in collector.events if event["event"] == "end"]
    assert ended["tick"] < 335 < report.ticks
    assert report.exit_code == 3


@pytest.mark.parametrize("wrong_by_m", [0.1 * TOLERANCE_M], indirect=True)
def test_less_than_the_tolerance_is_no_fault(wrong_by_m: float) -> None:
    loaded = load(1)
    assert run_virtual(loaded, RATE, circle(loaded)).exit_code == 0


def test_a_robot_may_chase_the_rows_of_a_stream() -> None:
    """Rows 20 mm apart: the robot is behind them for many ticks, and on the last one at the end."""
    points = [(0.05, 0.075)] * 200 + [(0.05, 0.095)] * 5 + [(0.05, 0.075 + 0.02 * (k % 2)) for k in range(20)]
    rows = [{"f0": Target(tip_m=(x, y, 0.0))} for x, y in points]
    report = run_virtual(load(1), RATE, None, rows=rows)
    assert report.exit_code == 0
    assert report.robots["f0"]["tip_error_max_mm"] > 1.0


def test_what_counts_as_off_the_path() -> None:
    """A limited tick counts on a trajectory, once the robot has caught up with it; never in a stream."""
    tally = RobotTally()
    tally.on_path(2e-3, True, True, 1.0)
    assert tally.off_m == 0.0
    assert tally.off_target_m == 2e-3  # would be, if the run ended here
    tally.on_path(0.0, False, True, 1.0)
    tally.on_path(1e-3, True, False, 1.0)
    assert tally.off_m == 0.0
    tally.on_path(1e-3, True, True, 1.0)
    tally.on_path(0.0, False, True, 1.0)
    tally.on_path(3e-3, True, True, 2.0)
    assert (tally.off_m, tally.off_target_m) == (1e-3, 3e-3)


def test_a_nearest_point_that_is_not_reached_ends_the_run_with_a_fault() -> None:
    """A last target out of reach counts by the nearest point; a robot of 2 mm/s is far from that."""
    slow = fingers(1).replace("velocity_mm_s: 100,", "velocity_mm_s: 2,")
    for text, exit_code in ((slow, 3), (fingers(1), 0)):
        loaded = parse_robot_file(text, "fingers.yaml")
        rows = "t_s,x_mm,y_mm\n0,50,75\n0.5,50,75\n0.7,50,395\n"
        report = run_virtual(loaded, SLOW_RATE, read_trajectory(io.StringIO(rows), "far.csv", loaded.driven))
        assert report.exit_code == exit_code
        assert report.robots["f0"]["ticks_unreachable"]
        assert report.robots["f0"]["fault"] == (Fault.TIP_OFF_TARGET if exit_code else Fault.NONE)


def test_a_target_that_was_within_reach_when_it_was_checked_and_is_not_in_the_run() -> None:
    """The nearest point is reached, which is enough only for a trajectory that was not refused anything."""
    loaded = load(1)
    rows = "t_s,x_mm,y_mm\n0,50,75\n0.5,50,75\n0.7,50,395\n1.5,50,75\n"
    trajectory = read_trajectory(io.StringIO(rows), "far.csv", loaded.driven)
    assert run_virtual(loaded, RATE, trajectory).exit_code == 0
    report = run_virtual(loaded, RATE, trajectory.accepted())
    assert report.exit_code == 3
    assert "within reach when it was checked" in report.robots["f0"]["message"]
    assert report.robots["f0"]["fault"] == Fault.TIP_OFF_TARGET


def test_what_the_check_accepts_is_marked_and_a_slower_copy_is_not() -> None:
    loaded = load(1)
    (config,) = build_robot_configs(loaded, RATE)
    accepted = Preflight([config]).trajectory(circle(loaded), "circle.csv")
    assert accepted.within_reach
    assert not accepted.stretched(2.0).within_reach
    assert (
        not Preflight([config], unreachable=Unreachable.NEAREST).trajectory(circle(loaded), "").within_reach
    )


def test_a_tick_in_which_a_limit_binds_both_axes_counts_once() -> None:
    loaded = load(1)
    still, away = ({"f0": Target(actuation=(length_m, length_m))} for length_m in (0.05, 0.09))
    report = run_virtual(loaded, RATE, None, rows=[still] * 20 + [away] * 120)
    robot = report.robots["f0"]
    assert 0 < max(robot["ticks_limited"].values()) <= robot["ticks_followed"]
