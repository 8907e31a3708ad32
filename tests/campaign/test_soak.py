"""Seconds of the soak; `python -m benchmarks.soak` is an hour of it, CONTID_SOAK_MINUTES sets any time."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from benchmarks import soak
from benchmarks.flat import Look, slope_of
from benchmarks.soak_lab import robot_file
from contid.robot_file.load import parse_robot_file

MINUTES = float(os.environ.get("CONTID_SOAK_MINUTES", "0.1"))


def looks(kb_per_h: float, descriptors_per_h: float = 0.0) -> list[Look]:
    """An hour, every five seconds, with the ups and downs of an allocator."""
    out = []
    for number in range(720):
        hours = number / 720.0
        own = 30_000.0 + kb_per_h * hours + (number * 7 % 11) * 12.0
        out.append(Look(3600.0 * hours, own, own, own, 20 + round(descriptors_per_h * hours)))
    return out


def test_a_leak_is_distinguished_from_noise() -> None:
    assert slope_of(looks(0.0)).flat
    assert slope_of(looks(0.0)).kb_per_h == pytest.approx(0.0, abs=100.0)
    leak = slope_of(looks(2000.0))
    assert not leak.flat
    assert leak.kb_per_h == pytest.approx(2000.0, abs=100.0)
    assert not slope_of(looks(0.0, descriptors_per_h=60.0)).flat


def test_the_laboratory_is_on_wires_only() -> None:
    loaded = parse_robot_file(robot_file(Path("/lab")), "lab.yaml")
    assert {bus.driver for bus in loaded.buses.values()} == {"dynamixel", "due"}
    assert len(loaded.buses) == len({bus.options.port for bus in loaded.buses.values()}) == 4  # type: ignore[attr-defined]  # both drivers have it


def test_some_of_it(capfd: pytest.CaptureFixture[str]) -> None:
    code = soak.soak(MINUTES, every_s=1.0, viewer_s=3.0)
    printed = capfd.readouterr().out
    assert code == 0, printed
    assert "verdict: memory and descriptors flat, nothing lost" in printed
