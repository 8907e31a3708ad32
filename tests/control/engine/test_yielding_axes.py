"""An axis of limited current may yield to what it pushes on, and is watched in everything else."""

from __future__ import annotations

import io
import math
from dataclasses import replace
from pathlib import Path

import pytest
from pydantic import BaseModel

from contid.control.engine.messages import Grip, Message
from contid.control.engine.report import RunReport
from contid.control.engine.virtual import run_virtual
from contid.control.tick.faults import Fault
from contid.control.tick.follow.expected_range import AxisResponse
from contid.hal import DeviceResponse
from contid.robot_file.load import parse_robot_file
from contid.session.read import Session
from contid.trajectory.read import read_trajectory
from contid_drivers.dynamixel.driver import DynamixelDriver
from contid_drivers.dynamixel.options import DynamixelAxisOptions, DynamixelBusOptions
from contid_drivers.sim import SimDriver
from contid_sessions.replay.replay import replay
from tests.session.runs import record_virtual
from tests.support.fingers import fingers

RATE = 200.0
WAY = "t_s,f0.x_mm,f0.y_mm\n0,50,75\n1,40,75\n3,60,85\n4,60,85\n"


@pytest.fixture
def yielding(monkeypatch: pytest.MonkeyPatch) -> None:
    """Simulated servos yield with their 1.47 A."""
    of_kind = SimDriver.device_response

    def response(self: SimDriver, bus: BaseModel, axis: BaseModel) -> DeviceResponse:
        return replace(of_kind(self, bus, axis), effort_limit_a=1.47)

    monkeypatch.setattr(SimDriver, "device_response", response)


def follow(fault: str, share: float = 1.0, rows: str = WAY) -> RunReport:
    """A way with a fault from 1.5 s on, the current limited to a share from the start."""
    text = fingers(1, options=f"faults:\n  - {{at_s: 1.5, axis: f0.left, {fault}}}\n")
    loaded = parse_robot_file(text.replace("device: servo,", "device: servo, overload_s: 60,"), "f.yaml")
    orders: dict[int, list[Message]] = {20: [Grip(share)]}
    way = read_trajectory(io.StringIO(rows), "way", loaded.driven)
    return run_virtual(loaded, RATE, way, orders=orders, ticks=900)


@pytest.mark.usefixtures("yielding")
def test_an_axis_that_pushes_with_its_current_is_held_and_no_fault() -> None:
    report = follow("kind: stall")
    assert report.exit_code == 0
    assert report.robots["f0"]["axes"]["left_mm"]["holds"]
    assert abs(report.robots["f0"]["axes"]["left_mm"]["difference"]) > 1.0
    assert "pushes on something" in str(report)


@pytest.mark.usefixtures("yielding")
@pytest.mark.parametrize(
    "fault",
    [
        "kind: scaled, share: 0.0",
        pytest.param("kind: scaled, share: -1.0", marks=pytest.mark.campaign),
        "kind: slow, share: 0.01",
    ],
)
def test_one_that_is_elsewhere_without_that_current_does_not_follow(fault: str) -> None:
    report = follow(fault)
    assert report.exit_code == 3
    assert report.robots["f0"]["fault"] == Fault.DOES_NOT_FOLLOW


@pytest.mark.usefixtures("yielding")
def test_a_grip_limits_the_current_that_counts() -> None:
    assert follow("kind: scaled, share: 0.0", share=0.0).exit_code == 0


@pytest.mark.usefixtures("yielding")
def test_a_grip_is_replayed(tmp_path: Path) -> None:
    """An axis that holds with the limited current would be a fault without the limit."""
    text = fingers(1, options="faults:\n  - {at_s: 1.5, axis: f0.left, kind: scaled, share: 0.0}\n")
    loaded = parse_robot_file(text.replace("device: servo,", "device: servo, overload_s: 60,"), "f.yaml")
    way = read_trajectory(io.StringIO(WAY), "way", loaded.driven)
    path = record_virtual(tmp_path / "s.mcap", loaded, way, {20: [Grip(0.0)]})
    assert replay(Session(path), loaded).divergence is None


@pytest.mark.usefixtures("yielding")
@pytest.mark.parametrize(
    ("by_deg", "fault"), [(20.0, Fault.MOVES_UNASKED), (3000.0, Fault.IMPLAUSIBLE_SAMPLE)]
)
def test_one_that_moves_unasked_is_a_fault(by_deg: float, fault: Fault) -> None:
    report = follow(f"kind: jump, by_deg: {by_deg}", rows="t_s,f0.x_mm,f0.y_mm\n0,50,75\n4,50,75\n")
    assert report.robots["f0"]["fault"] == fault


def test_pushing_is_an_effort_towards_the_command_of_a_part_of_its_limit() -> None:
    response = AxisResponse(0.1, 0.02, 0.04, math.inf, 1.0, pushing_a=0.3)
    assert response.holds(0.2, 0.31, 1.0)
    assert response.holds(-0.2, -0.31, 1.0)
    assert not response.holds(0.2, -0.31, 1.0)
    assert not response.holds(0.2, 0.29, 1.0)
    assert response.holds(0.2, 0.16, 0.5)  # the grip is limited to a half
    assert not replace(response, pushing_a=math.inf).holds(0.2, 5.0, 1.0)
    assert replace(response, pushing_a=0.0).holds(0.2, 0.0, 1.0)  # its limit is not in the file


@pytest.mark.parametrize(
    ("mode", "keys", "limit_a"),
    [
        ("extended_position", {"current_limit_ma": 500}, None),
        ("current_based_position", {"current_limit_ma": 500, "goal_current_ma": 400}, 0.4),
        ("current_based_position", {"current_limit_ma": 300}, 0.3),
        ("current_based_position", {}, 0.0),
    ],
)
def test_a_dynamixel_servo_yields_with_the_current_of_the_file(
    mode: str, keys: dict[str, float], limit_a: float | None
) -> None:
    axis = DynamixelAxisOptions.model_validate({"id": 1, "mode": mode, **keys})
    bus = DynamixelBusOptions.model_validate({"port": "/dev/ttyUSB0"})
    assert DynamixelDriver().device_response(bus, axis).effort_limit_a == limit_a
