"""Seconds of the soak; `python -m benchmarks.soak` is an hour of it, CONTID_SOAK_MINUTES sets any time."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from benchmarks import soak
from benchmarks.flat import Look, slope_of
from benchmarks.on_sigterm import EXIT_CODE
from benchmarks.soak_lab import robot_file
from contid.robot_file.load import parse_robot_file
from tests.support.rights import real_time_permitted

pytestmark = [pytest.mark.campaign, pytest.mark.realtime]

MINUTES = float(os.environ.get("CONTID_SOAK_MINUTES", "0.1"))

#: A benchmark with a daemon.
RUNS = """
import time
from contextlib import ExitStack
from benchmarks.on_sigterm import leave_on_sigterm
from tests.support.daemons import fast_daemon as daemon
leave_on_sigterm()
with ExitStack() as stack:
    running = stack.enter_context(daemon())
    print(running.process.pid, flush=True)
    time.sleep(600.0)
"""


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


@pytest.mark.skipif(not real_time_permitted(), reason="a soak needs the right to real-time priority")
def test_some_of_it(capfd: pytest.CaptureFixture[str]) -> None:
    code = soak.soak(MINUTES, every_s=1.0, viewer_s=3.0)
    printed = capfd.readouterr().out
    assert code == 0, printed
    assert "verdict: memory and descriptors flat, nothing lost" in printed


def test_a_daemon_ends_with_a_benchmark_that_gets_sigterm() -> None:
    benchmark = subprocess.Popen([sys.executable, "-c", RUNS], stdout=subprocess.PIPE, text=True)
    assert benchmark.stdout is not None
    with benchmark.stdout:
        daemon = psutil.Process(int(benchmark.stdout.readline()))
        family = [daemon, *daemon.children(recursive=True)]
        benchmark.send_signal(signal.SIGTERM)
        benchmark.send_signal(signal.SIGTERM)
        assert benchmark.wait(60.0) == EXIT_CODE
    assert psutil.wait_procs(family, timeout=30.0)[1] == []
