"""Two daemons, a bridge and operators, each a process of its own, over Unix sockets."""

from __future__ import annotations

import json
import os
import queue
import subprocess
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from contid.client import Client
from contid_fleet.net import NetSession
from contid_fleet.net_settings import NetSettings
from contid_fleet.operator import FleetOperator
from tests.support.command import contid
from tests.support.daemons import arrives, daemon, states
from tests.support.fleets import Fleet, bridge, machine_file, mover
from tests.support.ports import free_port
from tests.support.relay import Relay
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime]

BOTH = ("hand1", "hand2")


def in_fleet(lab: Fleet, verb: str, *arguments: str, name: str = "anna") -> subprocess.CompletedProcess[str]:
    return contid("fleet", verb, *arguments, "--file", str(lab.bridge.operator_file(name, BOTH)))


def ask(lab: Fleet, verb: str, node: str = "hand1", name: str = "anna", **fields: Any) -> dict[str, Any]:
    with FleetOperator(lab.bridge.operator(name)) as operator:
        until(lambda: operator.nodes().keys() >= {*BOTH}, "both nodes have a token")
        response = operator.ask(node, verb, fields, 10.0)
    assert response is not None
    return response


def resumed(lab: Fleet) -> None:
    for each in lab.daemons.values():
        with each.client() as client:
            client.resume(after_stop=True)


def test_one_table_has_every_robot(lab: Fleet) -> None:
    done = in_fleet(lab, "status", "--json")
    assert done.returncode == 0, done.stderr
    nodes = json.loads(done.stdout)["nodes"]
    assert {name: [*response["result"]["robots"]] for name, response in nodes.items()} == {
        "hand1": ["f0"],
        "hand2": ["f0"],
    }
    shown = in_fleet(lab, "status")
    assert shown.returncode == 0
    assert "hand1" in shown.stdout
    assert "hand2" in shown.stdout


def test_a_move_reaches_one_node_and_names_its_operator(lab: Fleet) -> None:
    done = in_fleet(lab, "move", "hand1", "x_mm=30", "y_mm=85")
    assert done.returncode == 0, done.stderr
    with lab.daemons["hand1"].client() as client:
        arrives(client, "f0", (30.0, 85.0, 0.0))
    with lab.daemons["hand2"].client() as client:
        assert client.status()["robots"]["f0"]["tip_mm"][0] == pytest.approx(0.0, abs=1.0)
    with mover(lab.bridge, "hand1", 1.0), lab.daemons["hand1"].client() as client:
        lease = client.status()["lease"]
        assert lease["holder"].startswith("fleet_mover.py[")
        assert lease["by"] == "anna"
    refused = in_fleet(lab, "move", "hand1", "x_mm=3000", "y_mm=85")
    assert refused.returncode == 2
    assert "x_mm" in refused.stderr or "reach" in refused.stderr


def test_a_trajectory_is_followed(lab: Fleet, tmp_path: Path) -> None:
    rows = tmp_path / "rows.csv"
    rows.write_text("t_s,x_mm,y_mm\n" + "".join(f"{0.05 * n},{30 - 0.5 * n},85\n" for n in range(40)))
    done = in_fleet(lab, "move", "hand2", "--trajectory", str(rows))
    assert done.returncode == 0, done.stderr
    with lab.daemons["hand2"].client() as client:
        arrives(client, "f0", (10.5, 85.0, 0.0))


@pytest.mark.parametrize(("verb", "expected"), [("hold", "HOLD"), ("stop", "OFF"), ("estop", "OFF")])
def test_a_stop_reaches_every_node(lab: Fleet, verb: str, expected: str) -> None:
    def stopped(client: Client) -> bool:
        return states(client) == {expected}

    with mover(lab.bridge, "hand1", 2.0):
        done = in_fleet(lab, verb, "--json", name="bob")  # who may only watch, and stop
    report = json.loads(done.stdout)
    assert done.returncode == 0, report
    assert report["confirmed"].keys() == {*BOTH}
    for name, each in lab.daemons.items():
        assert report["confirmed"][name]["tick"] > 0
        with each.client() as client:
            until(partial(stopped, client), "it has stopped")
            assert "by 'bob'" in (client.status()["lease"].get("stopped_by") or "")
    resumed(lab)


def test_a_stop_names_who_did_not_answer(lab: Fleet) -> None:
    path = str(lab.bridge.operator_file("anna", (*BOTH, "hand3")))
    done = contid("fleet", "hold", "--file", path)
    assert done.returncode == 4
    assert "hand1: hold confirmed in tick" in done.stdout
    assert "hand3: NO ANSWER within 1 s" in done.stdout
    assert "emergency switch" in done.stderr


def test_without_a_bridge_nothing_is_confirmed(tmp_path: Path) -> None:
    path = tmp_path / "anna.yaml"
    path.write_text(f"fleet: lab\nconnect: [unixsock-stream/{tmp_path}/none]\noperator: anna\n")
    done = contid("fleet", "estop", "--file", str(path))
    assert done.returncode == 4
    assert "no node is known" in done.stderr


def test_telemetry_and_events_are_the_lines_of_the_socket(lab: Fleet) -> None:
    received: queue.SimpleQueue[tuple[str, bytes]] = queue.SimpleQueue()
    with FleetOperator(lab.bridge.operator()) as operator:
        operator.net.subscribe("contid/lab/hand1/telemetry", lambda *sample: received.put(sample))
        key, line = received.get(timeout=10.0)
    frame = json.loads(line)
    with lab.daemons["hand1"].client() as client:
        local = next(client.telemetry(20.0))
    assert key == "contid/lab/hand1/telemetry"
    assert frame.keys() == local.keys()
    assert frame["robots"]["f0"].keys() == local["robots"]["f0"].keys()


def test_a_wildcard_moves_nothing(lab: Fleet) -> None:
    response = ask(lab, "acquire", node="*")
    assert response["error"]["code"] == "wildcard"
    response = ask(lab, "move", node="*", target={"x_mm": 0.0, "y_mm": 85.0})
    assert response["error"]["code"] == "wildcard"


def test_a_verb_in_the_payload_is_refused(lab: Fleet) -> None:
    smuggled = {"verb": "move", "target": {"x_mm": 0.0, "y_mm": 85.0}}
    with FleetOperator(lab.bridge.operator("bob")) as operator:
        until(lambda: operator.nodes().keys() >= {*BOTH}, "both nodes have a token")
        response = operator.ask("hand1", "status", smuggled, 10.0)
    assert response is not None
    assert response["error"]["code"] == "bad-request"


def test_who_may_watch_does_not_move(lab: Fleet) -> None:
    done = in_fleet(lab, "move", "hand1", "x_mm=0", "y_mm=85", name="bob")
    assert done.returncode == 2
    assert "needs the right" in done.stderr


def test_a_move_without_the_lease_is_refused(lab: Fleet) -> None:
    """At the socket it would take a free lease: what waited in a bridge that stood still must not."""
    assert ask(lab, "move", target={"x_mm": 0.0, "y_mm": 85.0})["error"]["code"] == "no-lease"
    for verb in ("resume", "recover", "clear_fault"):
        assert ask(lab, verb)["error"]["code"] == "no-lease"


def test_a_session_without_a_token_only_stops_and_reads(lab: Fleet) -> None:
    answers: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    net = NetSession(NetSettings(connect=[lab.bridge.endpoint]))
    try:
        until(net.peers, "the link is there")
        for verb in ("acquire", "hold", "status"):
            net.ask(f"contid/lab/hand1/do/anna/x/{verb}", b"", 10.0, lambda _, line: answers.put(line))
        found = sorted(json.loads(answers.get(timeout=10.0))["ok"] for _ in range(3))
    finally:
        net.close()
    assert found == [False, True, True]


def test_another_program_of_an_operator_does_not_keep_its_lease(lab: Fleet) -> None:
    with mover(lab.bridge, "hand1", 1.0) as moving, FleetOperator(lab.bridge.operator()) as watcher:
        until(lambda: watcher.nodes().keys() >= {*BOTH}, "both nodes have a token")
        moving.send_signal(19)  # SIGSTOP
        with lab.daemons["hand1"].client() as client:

            def held() -> bool:
                watcher.ask("hand1", "ping", {}, 1.0)
                return states(client) == {"HOLD"}

            until(held, "the lease of the stopped program lapsed")


def stopped_by_now(client: Client) -> bool:
    return states(client) == {"OFF"}


@pytest.mark.parametrize("delay_s", [0.0, 0.08])
def test_two_nodes_of_one_name_only_stop(delay_s: float) -> None:
    """The bridges do not reach each other; the operator reaches both, one of them over a slower link."""
    with ExitStack() as stack:
        one, two = (stack.enter_context(daemon()) for _ in range(2))
        first = stack.enter_context(bridge({"hand1": one.socket}))
        port = free_port()
        stack.enter_context(bridge({"hand1": two.socket}, endpoint=f"tcp/127.0.0.1:{port}"))
        relay = stack.enter_context(Relay(port, delay_s))
        slower = f"tcp/127.0.0.1:{relay.port}"
        file = first.operator().model_copy(update={"connect": [first.endpoint, slower]})
        path = first.folder / "both.yaml"
        path.write_text(f"fleet: lab\noperator: anna\nconnect: [{first.endpoint}, {slower}]\n")
        with FleetOperator(file) as operator:
            until(lambda: operator.nodes() == {"hand1": 2}, "both are seen")
        moved = contid("fleet", "move", "hand1", "x_mm=30", "y_mm=85", "--file", str(path))
        assert moved.returncode == 4
        assert "2 nodes have the name 'hand1'" in moved.stderr
        stopped = contid("fleet", "estop", "--file", str(path))
        assert stopped.returncode == 4
        assert "several nodes have this name" in stopped.stdout
        for each in (one, two):
            with each.client() as client:
                until(partial(stopped_by_now, client), "both stop, one of them later")


def test_the_environment_of_zenoh_is_ignored(tmp_path: Path) -> None:
    """A configuration of the environment would open a port at every address."""
    other = tmp_path / "zenoh.json5"
    other.write_text('{mode: "router", listen: {endpoints: ["tcp/0.0.0.0:0"]}}')
    env = {**os.environ, "ZENOH_CONFIG": str(other), "ZENOH_RUNTIME": "(rx: (worker_threads: nonsense))"}
    with daemon() as one, bridge({"hand1": one.socket}, env=env) as started:
        sockets = Path(f"/proc/{started.process.pid}/net/tcp").read_text()
        own = {
            str(link.readlink())
            for link in Path(f"/proc/{started.process.pid}/fd").iterdir()
            if link.is_symlink()
        }
        listening = [line.split() for line in sockets.splitlines()[1:] if line.split()[3] == "0A"]
        assert not [line for line in listening if f"socket:[{line[9]}]" in own]
        done = contid("fleet", "status", "--file", str(started.operator_file()))
        assert done.returncode == 0


def test_a_listener_beyond_this_machine_without_tls_is_refused(tmp_path: Path) -> None:
    path = machine_file(tmp_path, "tcp/192.168.1.10:7447", {"hand1": tmp_path / "s"})
    done = contid("fleet", "serve", str(path))
    assert done.returncode == 2
    assert "machine.yaml:" in done.stderr
    assert "without TLS" in done.stderr
