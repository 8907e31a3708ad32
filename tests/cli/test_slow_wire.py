"""A robot that holds over an adapter slower than its rate: the report counts every skipped tick."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.support.command import contid_in, emulating, environment

pytestmark = pytest.mark.process


def status(folder: Path) -> dict[str, object]:
    """The newest status; empty before the socket answers."""
    done = contid_in(folder, "status", "--socket", "s.sock", "--json")
    return dict(json.loads(done.stdout)) if done.returncode == 0 else {}


@pytest.mark.realtime
def test_ticks_skipped_in_hold_are_counted(tmp_path: Path, configs: Path) -> None:
    text = (configs / "finger.emulated.yaml").read_text()
    patient = "usb_latency_ms: 60\n    retry_ms: 80\n    watchdog_ms: 2000\n    fast_read: 'off'"
    baud = "    baud: 1000000\n"
    (tmp_path / "finger.yaml").write_text(text.replace(baud, f"{baud}    {patient}\n"))
    (tmp_path / "faults.jsonl").write_text("")
    with emulating(tmp_path, "finger.yaml", "--faults", "faults.jsonl"):
        process = subprocess.Popen(
            [sys.executable, "-m", "contid", "run", "finger.yaml", "--json", "--socket", "s.sock"],
            cwd=tmp_path, env=environment(), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
            stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        try:
            until = time.monotonic() + 20.0
            while "HOLD" not in json.dumps(status(tmp_path)):
                assert time.monotonic() < until, "the robot did not arm"
                time.sleep(0.1)
            with (tmp_path / "faults.jsonl").open("a") as faults:
                faults.write('{"fault": "delay", "id": 1, "ms": 14}\n{"fault": "delay", "id": 2, "ms": 14}\n')
            time.sleep(2.0)
        finally:
            process.send_signal(signal.SIGINT)
            out, _ = process.communicate(timeout=20)
    report = json.loads(out)
    assert report["robots"]["finger"]["message"] == ""
    # At 200 Hz an exchange of 15 ms leaves every third tick: two of three are skipped for 2 s.
    assert report["skipped"] >= 200
