"""Staleness tiers and the health of a bus."""

from __future__ import annotations

import math

import pytest

from contid.control.engine.staleness import Staleness, staleness_of
from contid.control.engine.tick_layout import RecordLayout, RobotLayout
from contid.remote.server.robot_fields import bus_health


def test_tiers_follow_the_age_and_the_rate() -> None:
    at_200_hz = [
        staleness_of(age_s, 0.005) for age_s in (0.0, 0.015, 0.016, 0.05, 0.1, 0.5, 1.1, float("inf"))
    ]
    fresh, late, stale, old, lost = Staleness
    assert at_200_hz == [fresh, fresh, late, late, stale, old, lost, lost]
    assert staleness_of(0.15, 0.05) is Staleness.FRESH
    assert staleness_of(0.16, 0.05) is Staleness.STALE


def test_a_bus_is_as_old_as_its_oldest_axis_and_names_those_that_are_silent() -> None:
    layout = RecordLayout("robots", 200.0, (RobotLayout("one", "x", "mm", ("left", "right", "never")),))
    packer = layout.packer()
    blank = packer.unpack(bytes(packer.size))
    record = layout.decode(blank)
    axis = record.robots[0].axes[0]
    read = (
        axis._replace(value=1.0, time_s=9.99, valid=1.0),
        axis._replace(value=1.0, time_s=9.90, valid=0.0),
        axis._replace(value=math.nan, time_s=10.0, valid=0.0),
    )
    record = record._replace(robots=(record.robots[0]._replace(axes=read),))
    buses = {"a": ["one.left"], "b": ["one.left", "one.right"], "c": ["one.left", "one.never"], "d": []}
    health = bus_health(layout, record, buses, 10.0)
    assert {name: bus["silent"] for name, bus in health.items()} == {
        "a": [], "b": ["one.right"], "c": ["one.never"], "d": [],
    }  # fmt: skip
    assert [bus["age_ms"] for bus in health.values()] == [
        pytest.approx(10.0),
        pytest.approx(100.0),
        None,
        None,
    ]
    assert [bus["tier"] for bus in health.values()] == ["fresh", "stale", "lost", "lost"]
