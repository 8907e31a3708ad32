"""`recover` over the socket and on the command line."""

from __future__ import annotations

import subprocess

import pytest

from contid.client import RemoteError
from tests.support.daemons import HERE, command, daemon, states
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime]

AXIS = "left: {bus: bus0, device: servo, velocity_deg_s: 1200, mm_per_rev: 37.7"


def test_a_robot_outside_its_limits_moves_by_recover_only() -> None:
    outside = f"{AXIS}, start_deg: 1000"  # 104.7 mm; the limit is 100 mm
    with daemon(change=lambda text: text.replace(AXIS, outside)) as running, running.client() as client:
        until(lambda: states(client) == {"FAULT"}, "it is reported")
        with pytest.raises(RemoteError, match="fault 109"):
            client.move(HERE)
        done = subprocess.run(
            command("recover", "--socket", str(running.socket)), capture_output=True, text=True, timeout=60
        )
        assert done.returncode == 0, done.stderr
        until(lambda: states(client) == {"HOLD"}, "it is inside")
        client.move(HERE, wait=True)
        with pytest.raises(RemoteError, match="nothing to recover"):
            client.recover(["f0"])
        running.end(130)


def test_a_robot_that_goes_to_fault_while_it_is_armed_was_not_resumed() -> None:
    outside = f"{AXIS}, start_deg: 1000"
    with daemon(2, change=lambda text: text.replace(AXIS, outside, 1)) as running, running.client() as client:
        until(lambda: states(client) == {"FAULT", "HOLD"}, "one is outside its limits")
        client.clear_fault(["f0"])
        with pytest.raises(RemoteError, match="f0: fault 109 outside-limits, ") as raised:
            client.resume(["f0"])
        assert raised.value.faults["f0"]["number"] == 109
        client.clear_fault(["f0"])
        assert client.resume(wait=False)["robots"].keys() == {"f0", "f1"}
        until(lambda: states(client) == {"FAULT", "HOLD"}, "it was found again")
        client.clear_fault(["f0"])
        resumed = client.resume()
        assert (resumed["robots"]["f1"], list(resumed["refused"])) == ("HOLD", ["f0"])
        client.clear_fault(["f0"])
        done = subprocess.run(
            command("resume", "f0", "--socket", str(running.socket)),
            capture_output=True, text=True, timeout=60,
        )  # fmt: skip
        assert done.returncode == 3, done.stdout
        assert "contid recover" in done.stderr
        running.end(3)
