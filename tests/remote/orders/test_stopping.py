"""Stops, faults and ends of a running daemon, by the journal of its devices."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from contextlib import suppress
from typing import Any

import pytest

from contid.client import Code, ConnectionLostError, NoDaemonError, RemoteError
from tests.support.daemons import HERE, armed, command, states
from tests.support.daemons import fast_daemon as daemon
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime]

SILENT = "faults:\n  - {at_s: 1.0, for_s: 1.0, kind: silent, axis: f0.left}\n"


@pytest.mark.parametrize("way", ["estop", "second Ctrl-C"])
@pytest.mark.parametrize("when", ["APPROACH", "RUN", "HOLD", "STOPPING"])
def test_torque_is_off_at_once_in_every_state(way: str, when: str) -> None:
    """Proof: the journal of the devices; the tick itself is in tests/control/engine/test_orders.py."""
    with daemon(on_interrupt="rest") as running, running.client() as client:
        armed(client)
        if when in ("APPROACH", "STOPPING"):
            client.move({"x_mm": 35.0, "y_mm": 80.0}, wait=False)
        if when == "RUN":
            begun = client.request("move", columns=["x_mm", "y_mm"])
            client.request("rows", move=begun["move"], rows=[[50.0, 75.0]])
            until(lambda: states(client) == {"RUN"}, "it follows")
        if when == "STOPPING":
            client.stop()
        if way == "estop":
            client.estop()
        else:
            os.kill(running.process.pid, signal.SIGINT)
            time.sleep(0.05)
            os.kill(running.process.pid, signal.SIGINT)
        until(running.off, "every device is without torque")
        if way == "estop":
            assert states(client) == {"OFF"}
            assert running.process.poll() is None
        else:
            running.process.wait(30)
        assert running.off()


def test_an_order_for_no_robot_is_refused_and_as_an_estop_stops_all() -> None:
    """A list that a filter left empty stops no robot, and must not be answered with ok."""
    with daemon() as running, running.client() as client:
        armed(client)
        for order in (client.hold, client.stop, client.resume):
            with pytest.raises(RemoteError, match="the list is empty") as refused:
                order(robots=[])
            assert refused.value.code == Code.BAD_REQUEST
        assert states(client) == {"HOLD"}
        with pytest.raises(RemoteError, match=r"the list is empty.*; all robots were stopped"):
            client.estop(robots=[])
        assert states(client) == {"OFF"}
        assert running.off()


def test_a_response_has_the_states_after_the_tick_that_obeyed() -> None:
    """A slow bus: the record of that tick is written 20 ms after the order was taken."""
    slow: dict[str, Any] = {
        "options": "latency_ms: 20",
        "change": lambda text: text.replace("rate_hz: 200", "rate_hz: 40"),
    }
    with daemon(**slow) as running, running.client() as client:
        armed(client)
        for _ in range(5):
            assert client.estop()["robots"] == {"f0": "OFF"}
            assert states(client) == {"OFF"}
            client.resume()


def test_a_malformed_estop_stops_all_robots() -> None:
    with daemon() as running, running.client() as client:
        armed(client)
        with pytest.raises(RemoteError, match="all robots were stopped"):
            client.request("estop", robots=["thumb"])
        assert running.off()


def test_the_response_to_hold_names_the_robots_that_do_not_hold() -> None:
    with daemon(2, on_interrupt="rest") as running, running.client() as client:
        armed(client)
        client.move({"f0.x_mm": 35.0, "f0.y_mm": 80.0})
        client.stop("f0")
        response = client.hold()
        assert response["robots"]["f1"] == "HOLD"
        assert response["refused"].keys() == {"f0"}
        assert "cannot hold while STOPPING" in response["refused"]["f0"]
        with pytest.raises(RemoteError, match="cannot hold while STOPPING"):
            client.hold("f0")


@pytest.mark.parametrize(
    ("fault", "axes"), [("lost", ["left", "right"]), ("silent, axis: f0.left", ["left"])]
)
def test_an_estop_names_the_axes_it_did_not_reach(fault: str, axes: list[str]) -> None:
    with daemon(options=f"faults: [{{at_s: 1.0, kind: {fault}}}]") as running, running.client() as client:
        armed(client)
        assert "silent" not in client.hold()
        until(lambda: states(client) == {"FAULT"}, "the devices fall silent")
        assert client.estop()["silent"] == {"f0": axes}
        for verb in ("estop", "stop"):
            done = subprocess.run(
                command(verb, "--socket", str(running.socket)), capture_output=True, text=True
            )
            assert f"f0: {', '.join(axes)} did not answer and may have missed the order" in done.stdout
            assert done.returncode == 4
            done = subprocess.run(
                command(verb, "--json", "--socket", str(running.socket)), capture_output=True, text=True
            )
            printed = json.loads(done.stdout)
            assert (printed["ok"], printed["silent"]) == (False, {"f0": axes})
            assert done.returncode == 4
        assert ("which is lost" in running.end(None)) == (fault == "lost")


def test_a_fault_is_explained_latched_and_cleared_without_motion() -> None:
    with daemon(options=SILENT) as running, running.client() as client:
        armed(client)
        until(lambda: states(client) == {"FAULT"}, "the axis falls silent")
        fault = client.status()["robots"]["f0"]["fault"]
        assert (fault["number"], fault["name"]) == (102, "axis-silent")
        assert "f0.left did not answer" in fault["what"]
        assert all(fault[key] for key in ("cause", "reaction", "remedy"))
        # First of all: the axis is silent for a second only, and starting a command may take longer.
        with pytest.raises(RemoteError, match=r"silent|does not answer"):
            client.clear_fault()
        for ask in (client.resume, lambda: client.move(HERE)):
            with pytest.raises(RemoteError) as refused:
                ask()
            assert refused.value.code == Code.FAULT
            assert refused.value.faults["f0"]["number"] == 102
        done = subprocess.run(
            command("resume", "--json", "--socket", str(running.socket)), capture_output=True, text=True
        )
        assert done.returncode == 3
        assert json.loads(done.stdout)["error"]["faults"]["f0"]["remedy"]
        while states(client) == {"FAULT"}:
            with suppress(RemoteError):
                client.clear_fault()
        assert states(client) == {"READY"}
        assert client.status()["robots"]["f0"]["enabled"] is False
        client.resume()
        assert states(client) == {"HOLD"}


def test_a_trajectory_that_a_fault_interrupts_is_no_success() -> None:
    """Its end in FAULT counted as arrival once: `contid move` exited with 0."""
    with daemon(options=SILENT) as running, running.client() as client:
        armed(client)
        rows = [(0.0, HERE["x_mm"], HERE["y_mm"]), (3.0, HERE["x_mm"] + 1.0, HERE["y_mm"])]
        with pytest.raises(RemoteError, match="f0 did not arrive") as ended:
            client.stream(["t_s", "x_mm", "y_mm"], rows)
        assert ended.value.faults["f0"]["number"] == 102


def test_a_trajectory_is_not_played_after_a_fault_while_it_was_sent() -> None:
    with daemon(options=SILENT) as running, running.client() as client:
        armed(client)
        move = client.request("move", columns=["t_s", "x_mm", "y_mm"])["move"]
        client.request("rows", move=move, rows=[[0.0, *HERE.values()], [1.0, *HERE.values()]])
        until(lambda: states(client) == {"FAULT"}, "the axis falls silent")
        with pytest.raises(RemoteError, match="fault 102") as refused:
            client.request("end", move=move)
        assert refused.value.code == Code.FAULT


def test_a_killed_daemon_is_noticed_and_its_socket_taken_over() -> None:
    with daemon() as running:
        client = running.client()
        armed(client)
        running.process.kill()
        running.process.wait()
        with pytest.raises(ConnectionLostError, match="hold"):
            client.status()
        client.close()
        with pytest.raises(NoDaemonError):
            running.client()
        until(running.off, "the control process or the dead-man rests the devices")
