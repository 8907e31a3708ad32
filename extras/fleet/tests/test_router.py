"""A router between operators and machines: rights and names are bound there, and robots hold without it."""

from __future__ import annotations

import queue
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from contid.errors import BadInputError
from contid_fleet.certificates import make_ca, make_certificate
from contid_fleet.fleet_file import MachineFile, OperatorFile
from contid_fleet.keys import Keys
from contid_fleet.net import NetSession
from contid_fleet.net_settings import LINK_LEASE_S, NetSettings
from contid_fleet.operator import FleetOperator
from contid_fleet.router import RouterFile
from contid_fleet.stops import stop_fleet
from tests.support.command import contid
from tests.support.daemons import Running, armed, command, daemon, states
from tests.support.fleets import BridgeProcess, bridge, machine_file, mover, router, router_file
from tests.support.ports import free_port
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime]

RIGHTS = {"anna": ["watch", "move", "arm"], "bob": ["watch"]}
#: The promise is min(lease, lease of the link) + 50 ms; the rest is for a machine that does other work too.
MARGIN_S = 1.25


@dataclass
class Star:
    """A daemon and its bridge behind a router, with certificates."""

    node: Running
    bridge: BridgeProcess
    router: BridgeProcess
    certificates: Path

    def tls(self, name: str) -> dict[str, str]:
        own = {
            "certificate": str(self.certificates / f"{name}.pem"),
            "key": str(self.certificates / f"{name}.key"),
        }
        return {"ca": str(self.certificates / "ca.pem"), **own}

    def operator(self, name: str, certificate: str | None = None) -> OperatorFile:
        return self.router.operator(name, ["hand1"], tls=self.tls(certificate or name))


@pytest.fixture(scope="module")
def star(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Star]:
    folder = tmp_path_factory.mktemp("ca")
    make_ca(folder, "lab")
    for name in ("hub", "pc1", "pc2"):
        make_certificate(folder, folder, name, ["127.0.0.1"])
    for name in ("anna", "bob", "eve"):
        make_certificate(folder, folder, name)
    endpoint = f"tls/127.0.0.1:{free_port()}"
    with daemon() as node, ExitStack() as stack:
        with node.client() as client:
            armed(client)
        made = Star(node, None, None, folder)  # type: ignore[arg-type]  # they follow
        machines = {"pc1": ["hand1"], "pc2": ["hand2"]}
        keys: dict[str, Any] = {"operators": RIGHTS, "trust_local_users": None}
        made.router = stack.enter_context(router(machines, endpoint, tls=made.tls("hub"), **keys))
        behind: dict[str, Any] = {
            "listen": None,
            "connect": [endpoint],
            "router": "hub",
            "tls": made.tls("pc1"),
        }
        made.bridge = stack.enter_context(bridge({"hand1": node.socket}, endpoint=endpoint, **keys, **behind))
        yield made


def test_an_operator_moves_and_stops_through_the_router(star: Star) -> None:
    path = str(star.router.operator_file("anna", ["hand1"], tls=star.tls("anna")))
    moved = contid("fleet", "move", "hand1", "x_mm=30", "y_mm=85", "--file", path)
    assert moved.returncode == 0, moved.stderr
    stopped = contid("fleet", "hold", "--file", path)
    assert stopped.returncode == 0, stopped.stdout
    assert "hand1: hold confirmed in tick" in stopped.stdout
    with star.node.client() as client:
        assert states(client) == {"HOLD"}


def test_who_may_watch_receives_telemetry_and_only_stops(star: Star) -> None:
    received: list[bytes] = []
    with FleetOperator(star.operator("bob")) as bob:
        until(lambda: "hand1" in bob.nodes(), "the node is there")
        bob.net.subscribe(bob.keys.telemetry("hand1"), lambda _, line: received.append(line))
        until(lambda: len(received) > 3, "telemetry comes through the router")
        until(lambda: (bob.ask("hand1", "hold", {}, 5.0) or {}).get("ok"), "it holds")
        for verb in ("acquire", "move", "resume"):
            assert bob.ask("hand1", verb, {}, 0.5) is None


@pytest.mark.parametrize("certificate", ["bob", "eve", "pc2"])
def test_another_name_than_that_of_the_certificate_reaches_nothing(star: Star, certificate: str) -> None:
    """The bridge sees the name of the router only: the router refuses the name of another operator."""
    with FleetOperator(star.operator("anna", certificate)) as operator:
        until(operator.net.peers, "the link to the router is there")
        for verb in ("status", "acquire", "move", "hold"):
            assert operator.ask("hand1", verb, {}, 0.5) is None
        report = stop_fleet(operator, "estop", ["hand1"])
        assert report.missing == ("hand1",)
        assert not report.complete
    with FleetOperator(star.operator("anna")) as anna:
        until(lambda: (anna.ask("hand1", "status", {}, 5.0) or {}).get("ok"), "with the right one it does")


@pytest.mark.parametrize("certificate", ["pc2", "anna"])
def test_a_machine_is_only_its_own_nodes(star: Star, certificate: str) -> None:
    """Another machine, or an operator, neither confirms stops for hand1 nor moves it nor publishes for it."""
    received: list[bytes] = []
    endpoint = star.router.endpoint
    settings = star.operator("bob", certificate).tls
    with FleetOperator(star.operator("anna")) as anna:
        until(lambda: anna.nodes() == {"hand1": 1}, "the node is there")
        keys = anna.keys
        anna.net.subscribe(keys.telemetry("hand1"), lambda _, line: received.append(line))
        until(lambda: received, "telemetry comes through the router")
        net = NetSession(NetSettings(connect=[endpoint], tls=settings, connect_timeout_s=5.0, mode="client"))
        try:
            net.token(keys.alive("hand1", "wrong"))
            net.serve(
                keys.do("hand1", "*", "*", "*"),
                lambda question: question.answer(question.key, b'{"ok":true}'),
            )
            for _ in range(5):
                net.put(keys.telemetry("hand1"), b"wrong")
                response = anna.ask("hand1", "status", {}, 5.0)
                # The false one answers without a result.
                assert response is None or "result" in response
                time.sleep(0.05)
            until(lambda: anna.ask("hand1", "status", {}, 5.0), "the true one answers")
            assert anna.nodes() == {"hand1": 1}
            assert b"wrong" not in received
        finally:
            net.close()


def nothing_answers(net: NetSession) -> None:
    """Ask in the name of an operator that is not this session's."""
    keys, answers = Keys("lab"), queue.SimpleQueue[bytes]()
    net.token(keys.who("anna", "s"))
    for verb in ("status", "hold", "acquire"):
        net.ask(keys.do("hand1", "anna", "s", verb), b"", 0.5, lambda _, line: answers.put(line))
    time.sleep(1.0)
    assert answers.empty()


def test_a_machine_asks_nothing(star: Star) -> None:
    settings = NetSettings(connect=[star.router.endpoint], tls=star.operator("bob", "pc2").tls, mode="client")
    net = NetSession(settings)
    try:
        nothing_answers(net)
    finally:
        net.close()


def test_a_bridge_takes_orders_from_its_router_only(star: Star) -> None:
    """A machine whose address it trusts is not the router: nothing of it comes through."""
    endpoint = f"tls/127.0.0.1:{free_port()}"
    false = NetSettings([endpoint], tls=star.operator("bob", "pc2").tls, mode="router")
    net = NetSession(false)
    try:
        behind: dict[str, Any] = {
            "listen": None,
            "connect": [endpoint],
            "router": "hub",
            "tls": star.tls("pc1"),
        }
        keys: dict[str, Any] = {"operators": RIGHTS, "trust_local_users": None}
        with bridge({"hand1": star.node.socket}, endpoint=endpoint, **keys, **behind) as served:
            assert served.process.poll() is None
            nothing_answers(net)
    finally:
        net.close()


@pytest.mark.parametrize(
    ("number", "lease_s", "limit_s"),
    [(signal.SIGKILL, 5.0, 0.0), (signal.SIGSTOP, 0.5, 0.5), (signal.SIGSTOP, 5.0, LINK_LEASE_S)],
    ids=["killed", "stopped, lease", "stopped, link"],
)
def test_without_the_router_the_robot_holds(number: signal.Signals, lease_s: float, limit_s: float) -> None:
    with ExitStack() as stack:
        node = stack.enter_context(daemon())
        hub = stack.enter_context(router({"pc1": ["hand1"]}))
        behind: dict[str, Any] = {"listen": None, "connect": [hub.endpoint]}
        stack.enter_context(bridge({"hand1": node.socket}, endpoint=hub.endpoint, **behind))
        client = stack.enter_context(node.client())
        armed(client)
        stack.enter_context(mover(hub, "hand1", lease_s))
        until(lambda: states(client) == {"RUN"}, "it follows")
        begin_s = time.monotonic()
        hub.process.send_signal(number)
        until(lambda: states(client) == {"HOLD"}, "the robot holds")
        assert time.monotonic() - begin_s < limit_s + MARGIN_S


def _sees_the_node(operator: FleetOperator) -> bool:
    return operator.nodes() == {"hand1": 1}


def _answers(operator: FleetOperator) -> bool:
    return bool((operator.ask("hand1", "status", {}, 5.0) or {}).get("ok"))


def test_a_bridge_waits_for_its_router_and_finds_it_again() -> None:
    with ExitStack() as stack:
        node = stack.enter_context(daemon())
        # Short: the path of a socket has 107 bytes.
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="contid-")))
        endpoint = f"unixsock-stream/{folder}/hub"
        path = machine_file(folder, endpoint, {"hand1": node.socket}, listen=None, connect=[endpoint])
        served = subprocess.Popen(
            command("fleet", "serve", str(path)), stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        stack.callback(served.communicate)
        stack.callback(served.terminate)
        assert served.stderr is not None
        assert "waiting for the router" in served.stderr.readline()
        for _ in range(2):
            with router({"pc1": ["hand1"]}, endpoint) as hub, FleetOperator(hub.operator()) as operator:
                until(partial(_sees_the_node, operator), "the node is there")
                until(partial(_answers, operator), "it answers")
            (folder / "hub").unlink(missing_ok=True)


def test_a_second_bridge_with_the_same_name_is_refused(tmp_path: Path) -> None:
    with daemon() as one, daemon() as two, router({"pc1": ["hand1"]}) as hub:
        behind: dict[str, Any] = {"listen": None, "connect": [hub.endpoint]}
        with bridge({"hand1": one.socket}, endpoint=hub.endpoint, **behind):
            path = machine_file(tmp_path, hub.endpoint, {"hand1": two.socket}, **behind)
            done = contid("fleet", "serve", str(path))
        assert done.returncode == 4
        assert "'hand1' is in fleet 'lab' already" in done.stderr


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"machines": {"pc1": ["hand1"], "pc2": ["hand1"]}}, "'hand1' is at 'pc1' and at 'pc2'"),
        ({"machines": {}}, "machines"),
        ({"connect": ["tcp/127.0.0.1:7448"]}, "a router listens only"),
        ({"trust_local_users": None}, "names of operators are not verified"),
        ({"listen": ["tcp/192.168.1.10:7447"]}, "leaves this machine without TLS"),
    ],
)
def test_a_wrong_file_of_a_router_is_refused(change: dict[str, Any], message: str, tmp_path: Path) -> None:
    machines = change.pop("machines", {"pc1": ["hand1"]})
    path = router_file(tmp_path, "tcp/127.0.0.1:7447", machines, **change)
    with pytest.raises(BadInputError, match=message):
        RouterFile.load(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"connect": ["tcp/127.0.0.1:7448"]}, "give one of them"),
        (
            {
                "listen": None,
                "connect": ["tls/10.0.0.1:7447"],
                "tls": {"ca": "c", "certificate": "c", "key": "k"},
            },
            "needs router: NAME",
        ),
    ],
)
def test_a_machine_behind_a_router_names_it(change: dict[str, Any], message: str, tmp_path: Path) -> None:
    path = machine_file(tmp_path, "tcp/127.0.0.1:7447", {}, **change)
    with pytest.raises(BadInputError, match=message):
        MachineFile.load(path)
