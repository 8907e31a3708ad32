"""Bars of `contid status`."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import pytest
from rich.console import Console

from contid.cli.support.render_status import BAR, bar, render_status
from tests.support.daemons import daemon


def test_bars_stay_within_their_width() -> None:
    assert [len(bar(value, 0.0, 10.0)) for value in (None, -5.0, 0.0, 5.0, 10.0, 50.0)] == [BAR] * 6
    assert bar(5.0, 0.0, 10.0).count("█") == BAR // 2


def test_robots_with_a_fault_are_above_the_others() -> None:
    """A live view of a low terminal ends with dots where it is cut off."""
    fault = {
        "number": 110,
        "name": "tendon-slack",
        "what": "s1.t1",
        "cause": "c",
        "reaction": "r",
        "remedy": "m",
    }
    faulty = {"state": "FAULT", "fault": fault, "enabled": True, "tip_mm": None, "error_mm": None, "axes": {}}
    status = {
        "name": "lab", "rate_hz": 200.0, "tick": 1, "clients": 0, "lease": {"holder": None},
        "lateness_us": {"p50": None, "max": None}, "buses": {}, "warnings": [],
        "robots": {"left": {"state": "RUN"}, "right": faulty, "third": {"state": "RUN"}},
    }  # fmt: skip
    console = Console(width=80)
    with console.capture() as shown:
        console.print(render_status(status))
    places = [shown.get().index(text) for text in ("right", "fault 110 tendon-slack", "left", "third")]
    assert places == sorted(places)


@pytest.mark.process
def test_a_watch_in_json_reports_on_stderr_that_there_is_no_daemon(tmp_path: Path) -> None:
    watch = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "contid",
            "status",
            "--watch",
            "--json",
            "--socket",
            str(tmp_path / "none.sock"),
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert watch.stderr is not None
        assert "none.sock" in watch.stderr.readline()
        time.sleep(2.5)
    finally:
        watch.kill()
        out, rest = watch.communicate()
    assert out == ""
    assert rest == ""


@pytest.mark.process
@pytest.mark.realtime
def test_a_watch_into_a_pipe_is_written_as_it_comes() -> None:
    with daemon() as running:
        watch = subprocess.Popen(
            [sys.executable, "-m", "contid", "status", "--watch", "--socket", str(running.socket)],
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            assert watch.stdout is not None
            lines = iter(watch.stdout.readline, "")
            assert len([next(line for line in lines if "lease:" in line) for _ in range(2)]) == 2
        finally:
            watch.kill()
            watch.communicate()
