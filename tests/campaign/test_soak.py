"""Seconds of the soak; hours of it are `python -m benchmarks.soak`."""

from __future__ import annotations

import pytest

from benchmarks import soak
from contid.description.load import parse_robot_file


def test_the_laboratory_loses_one_bus_after_the_other() -> None:
    loaded = parse_robot_file(soak.robot_file(60.0, 3600.0), "lab.yaml")
    times = sorted(fault.at_s for bus in loaded.buses.values() for fault in bus.options.faults)
    assert times == [60.0 * minute for minute in range(1, 61)]
    assert {bus.driver for bus in loaded.buses.values()} == {"sim"}


def test_seconds_of_it(capfd: pytest.CaptureFixture[str]) -> None:
    assert soak.soak(minutes=6.0 / 60.0, every_s=3.0) == 0
    assert "processes lost: False" in capfd.readouterr().out
