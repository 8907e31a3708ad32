"""A control process that stands still for a while: skipped ticks and the fault are reported as its own."""

from __future__ import annotations

import json
import os
import signal
import time

import psutil
import pytest

from contid.control.tick.faults import Fault
from tests.support.daemons import armed, states
from tests.support.daemons import fast_daemon as daemon
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime]

#: Longer than the watchdog of the devices, shorter than what the daemon lets pass.
STOOD_S = 0.35


def test_a_stall_while_holding_is_counted_and_named() -> None:
    with daemon(options="watchdog_ms: 200") as running, running.client() as client:
        armed(client)
        (control,) = [
            child.pid
            for child in psutil.Process(running.process.pid).children()
            if "contid.control.process" in child.cmdline()
        ]
        os.kill(control, signal.SIGSTOP)
        time.sleep(STOOD_S)
        os.kill(control, signal.SIGCONT)
        until(lambda: states(client) == {"FAULT"}, "the devices have tripped")
        status = client.status()
        fault = status["robots"]["f0"]["fault"]
        assert fault["number"] == Fault.LOOP_STALLED
        assert "the loop stood still for " in fault["what"]
        assert "real-time" in fault["remedy"]
        skipped = STOOD_S * status["rate_hz"]
        assert status["skipped"] >= 0.9 * skipped
        assert status["longest_gap_ms"] >= 1e3 * STOOD_S
        running.process.send_signal(signal.SIGTERM)
        out, _ = running.process.communicate(timeout=30)
        report = json.loads(out)
        assert report["skipped"] >= 0.9 * skipped
        assert report["longest_gap_ms"] >= status["longest_gap_ms"]
        assert report["lateness"]["max_us"] >= 0.9e6 * STOOD_S
