"""Robots found outside their limits: nothing moves them but `recover`, slowly."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contid.control.engine.messages import (
    ClearFault,
    Estop,
    Finish,
    Goto,
    Hold,
    Mark,
    Message,
    Recover,
    Resume,
    Rows,
    Stop,
)
from contid.control.tick.axis_motions import RECOVER_SHARE
from contid.control.tick.faults import Fault
from contid.control.tick.supervisor import Mode
from contid.robot_file.base import StopPolicy
from contid.robot_file.load import LoadedFile, parse_robot_file
from contid.targets import Target
from tests.support.fingers import Collector, circle, fingers, run_virtual

RATE, MM_PER_REV = 200.0, 37.7
VELOCITY, ACCELERATION, JERK = 0.1, 1.0, 20.0
HERE = Target(tip_m=(0.05, 0.075, 0.0))
#: Every order that a client may give, but recover.
OTHERS: Sequence[Message] = (
    Hold(), Resume(), Stop(), Stop(policy=StopPolicy.REST), Estop(), ClearFault(), Goto("f0", HERE),
    Rows({"f0": HERE}),
)  # fmt: skip


def file_with_start(left_mm: float, on_fault: str = "hold") -> LoadedFile:
    """A finger whose left axis stands at a length; its limits are 0 to 100 mm."""
    degrees = left_mm / MM_PER_REV * 360.0
    plain = "left: {bus: bus0, device: servo, velocity_deg_s: 1200, mm_per_rev: 37.7}"
    text = fingers(1, on_fault=on_fault)
    assert plain in text
    return parse_robot_file(text.replace(plain, f"{plain[:-1]}, start_deg: {degrees!r}}}"), "fingers.yaml")


def run(loaded: LoadedFile, orders: Mapping[int, Sequence[Message]], ticks: int) -> Collector:
    """An attended run: it goes on with every robot in FAULT."""
    seen = Collector(loaded)
    script: dict[int, Sequence[Message]] = {1: [Mark(0)], **orders}
    run_virtual(loaded, RATE, None, sinks=[seen], orders=script, ticks=ticks)
    return seen


def path(seen: Collector) -> np.ndarray:
    """Commands of both axes, tick by tick [m]; NaN where nothing is commanded."""
    return np.array([[axis.command for axis in record.robots[0].axes] for record in seen.records])


def devices(seen: Collector) -> np.ndarray:
    return np.array([[axis.device for axis in record.robots[0].axes] for record in seen.records])


@pytest.mark.parametrize(
    ("left_mm", "on_fault"),
    [
        *((-8.0, "hold"), (103.0, "relax"), (130.0, "relax")),
        *(
            pytest.param(*each, marks=pytest.mark.campaign)
            for each in ((-8.0, "relax"), (103.0, "hold"), (130.0, "hold"))
        ),
    ],
)
def test_it_is_reported_and_nothing_moves(left_mm: float, on_fault: str) -> None:
    seen = run(file_with_start(left_mm, on_fault), {}, 300)
    (fault,) = [event for event in seen.events if event["event"] == "fault"]
    assert fault["fault"] == Fault.OUTSIDE_LIMITS
    found = re.fullmatch(r"f0.left is at (\S+) mm, its limit is (0|100) mm", str(fault["detail"]))
    assert found
    assert float(found[1]) == pytest.approx(left_mm, abs=0.05)
    sent = devices(seen)
    assert np.all(np.isnan(sent) | (sent == sent[-1]))
    assert seen.modes("f0")[-1] == "FAULT"


@pytest.mark.slow
@settings(max_examples=8, deadline=None)
@given(
    left_mm=st.floats(-40.0, -3.0) | st.floats(103.0, 140.0),
    orders=st.lists(st.tuples(st.integers(20, 400), st.sampled_from(OTHERS)), max_size=8),
)
def test_no_other_order_moves_it(left_mm: float, orders: list[tuple[int, Message]]) -> None:
    script: dict[int, list[Message]] = {}
    for tick, message in orders:
        script.setdefault(tick, []).append(message)
    commands = path(run(file_with_start(left_mm), script, 500))
    commanded = commands[~np.isnan(commands[:, 0])]
    # Arming again reads the position again: equal but for the resolution of the sensor.
    assert np.all(np.abs(commanded - commanded[:1]) < 1e-4)


@pytest.mark.parametrize(
    ("on_fault", "left_mm"),
    [
        *(("hold", -8.0), ("hold", 130.0), ("relax", 103.0)),
        *(pytest.param("relax", left_mm, marks=pytest.mark.campaign) for left_mm in (-8.0, 130.0)),
        pytest.param("hold", 103.0, marks=pytest.mark.campaign),
    ],
)
def test_recover_moves_it_inside_slowly_and_then_it_follows(left_mm: float, on_fault: str) -> None:
    loaded = file_with_start(left_mm, on_fault)
    seen = run(loaded, {50: [Recover()], 800: [Goto("f0", HERE)]}, 1400)
    commands = path(seen)[:800, 0]
    commands = commands[~np.isnan(commands)]
    steps = np.diff(commands) * RATE
    accelerations = np.diff(np.concatenate([[0.0], steps])) * RATE
    assert np.abs(steps).max() <= VELOCITY * RECOVER_SHARE * (1 + 1e-6)
    assert np.abs(accelerations).max() <= ACCELERATION * RECOVER_SHARE * (1 + 1e-6)
    assert np.abs(np.diff(accelerations)).max() * RATE <= JERK * RECOVER_SHARE * (1 + 1e-3)
    assert commands[-1] == (0.0 if left_mm < 0.0 else 0.1)
    modes = [Mode(record.robots[0].mode) for record in seen.records]
    assert modes[799] is Mode.HOLD
    arrivals = [event["arrived"] for event in seen.events if event["event"] == "goto"]
    assert arrivals == [True]


def test_a_hold_stops_the_recovery_and_a_second_recover_goes_on() -> None:
    orders: dict[int, Sequence[Message]] = {
        50: [Recover()],
        150: [Hold()],
        300: [Goto("f0", HERE)],
        400: [Recover()],
        800: [Recover()],
    }
    seen = run(file_with_start(110.0), orders, 1400)
    commands = path(seen)[:, 0]
    assert 0.1 < commands[300] == commands[399] < 0.11
    assert commands[-1] == 0.1
    refused = [str(event["message"]) for event in seen.events if event["event"] == "refused"]
    assert len(refused) == 2
    assert "recover first" in refused[0]
    assert "nothing to recover" in refused[1]


def test_recover_is_refused_within_limits_and_in_other_faults() -> None:
    seen = run(file_with_start(50.0), {50: [Recover(("f0",))]}, 100)
    (refused,) = [event for event in seen.events if event["event"] == "refused"]
    assert "nothing to recover" in str(refused["message"])


def test_an_unattended_run_ends_with_the_fault() -> None:
    loaded = file_with_start(110.0)
    report = run_virtual(loaded, RATE, circle(loaded))
    assert report.exit_code == 3
    assert report.robots["f0"]["fault"] == Fault.OUTSIDE_LIMITS


def test_a_small_excess_is_followed_from_where_it_is() -> None:
    """Noise around a limit is no reason to stop: within 2 % of the travel the approach goes inside."""
    loaded = file_with_start(101.0)
    seen = Collector(loaded)
    assert run_virtual(loaded, RATE, circle(loaded), sinks=[seen]).exit_code == 0
    held = run(file_with_start(101.0), {100: [Finish()]}, 200)
    commands = path(held)[:, 0]
    commands = commands[~np.isnan(commands)]
    assert math.isclose(commands[0], 0.101, abs_tol=1e-4)
    assert np.all(commands == commands[0])
