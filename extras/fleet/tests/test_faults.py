"""Who moves a robot by network stands still or is killed: it holds, and what comes late moves nothing."""

from __future__ import annotations

import math
import queue
import signal
import subprocess
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from contid.client import Client
from contid.remote.protocol.wire import decode, encode
from contid.remote.server.move import LIVE_ROWS
from contid_fleet.fleet_address import FleetAddress
from contid_fleet.net_settings import LINK_LEASE_S
from contid_fleet.operator import FleetOperator
from tests.support.daemons import Running, armed_daemon, arrives, states
from tests.support.daemons import fast_daemon as daemon
from tests.support.fleet_faults import FAULTS, measure
from tests.support.fleets import BridgeProcess, bridge, mover
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime]

#: The promise is min(lease, lease of the link) + 50 ms; the rest is for a machine that does other work too.
PROMISE_S = 0.05
MARGIN_S = 1.2


@pytest.fixture(scope="module")
def node() -> Iterator[Running]:
    with armed_daemon(rate_hz=200) as started:
        yield started


@pytest.fixture
def served(node: Running) -> Iterator[BridgeProcess]:
    """A bridge of its own: some tests kill it."""
    with bridge({"hand1": node.socket}) as started:
        yield started


def held_after(client: Client, begin_s: float) -> float:
    """Seconds until the robot holds."""
    until(lambda: states(client) == {"HOLD"}, "the robot holds")
    return time.monotonic() - begin_s


def stays(client: Client, seconds: float) -> None:
    """The command stands still once the stop with limited jerk is over."""
    time.sleep(0.5)
    before = client.status()["robots"]["f0"]["axes"]
    time.sleep(seconds)
    after = client.status()["robots"]["f0"]
    assert after["state"] == "HOLD"
    assert {n: a["command_mm"] for n, a in after["axes"].items()} == {
        n: a["command_mm"] for n, a in before.items()
    }


@pytest.mark.parametrize(
    ("number", "lease_s", "limit_s"),
    [
        (signal.SIGKILL, 5.0, 0.0),  # its link is closed
        (signal.SIGSTOP, 0.5, 0.5),
        (signal.SIGSTOP, 5.0, LINK_LEASE_S),  # its token is gone before its lease lapses
        (signal.SIGUSR1, 0.5, 0.5),  # it hangs, while the threads of Zenoh keep its token
    ],
    ids=["killed", "stopped, lease", "stopped, link", "hangs"],
)
def test_without_the_operator_the_robot_holds(
    node: Running, served: BridgeProcess, number: signal.Signals, lease_s: float, limit_s: float
) -> None:
    with mover(served, "hand1", lease_s) as moving, node.client() as client:
        assert states(client) == {"RUN"}
        begin_s = time.monotonic()
        moving.send_signal(number)
        assert held_after(client, begin_s) < limit_s + PROMISE_S + MARGIN_S
        assert client.status()["lease"]["holder"] is None
        if number == signal.SIGSTOP:
            moving.send_signal(signal.SIGCONT)
            stays(client, 0.5)
            assert moving.wait(timeout=20) != 0  # its stream has ended, and it is not begun anew


@pytest.mark.parametrize(
    ("number", "limit_s"), [(signal.SIGKILL, 0.0), (signal.SIGSTOP, 0.5)], ids=["killed", "stopped"]
)
def test_without_the_bridge_the_robot_holds(
    node: Running, served: BridgeProcess, number: signal.Signals, limit_s: float
) -> None:
    with mover(served, "hand1", 0.5), node.client() as client:
        assert states(client) == {"RUN"}
        begin_s = time.monotonic()
        served.process.send_signal(number)
        assert held_after(client, begin_s) < limit_s + PROMISE_S + MARGIN_S
        if number == signal.SIGSTOP:
            served.process.send_signal(signal.SIGCONT)
        stays(client, 0.5)


@pytest.mark.parametrize(
    ("name", "lease_s"),
    [("link cut", 0.4), ("link cut", 2.0), ("link cut for 300 ms", 1.0)],
    ids=["lease", "link", "short"],
)
def test_a_silent_link_holds_the_robot_and_a_short_one_does_not(
    node: Running, name: str, lease_s: float
) -> None:
    fault = FAULTS[name]
    held_s = measure(node, fault, lease_s, 0.1)
    limit_s = fault.limit_s(lease_s)
    if limit_s == math.inf:
        assert held_s == math.inf
    else:
        assert 0.1 < held_s < limit_s + PROMISE_S + MARGIN_S


def test_an_order_that_waited_in_a_stopped_bridge_moves_nothing(node: Running, served: BridgeProcess) -> None:
    answers: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    with FleetOperator(served.operator()) as operator, node.client() as client:
        Client(FleetAddress(operator, "hand1")).acquire(0.5)
        served.process.send_signal(signal.SIGSTOP)
        key = operator.keys.do("hand1", "anna", operator.origin.session, "move")
        move = encode({"target": {"x_mm": -20.0, "y_mm": 80.0}})[:-1]
        operator.net.ask(key, move, 60.0, lambda _, line: answers.put(line))
        until(lambda: client.status()["lease"]["holder"] is None, "the lease lapsed")
        served.process.send_signal(signal.SIGCONT)
        # The link may have been closed meanwhile: then there is no answer, and nothing moves either.
        stays(client, 1.0)
        if not answers.empty():
            assert decode(answers.get())["error"]["code"] in ("no-lease", "refused", "expired")


def test_of_live_rows_the_newest_wins(node: Running, served: BridgeProcess) -> None:
    """Rows that arrive at once, as after a stall of the network, are not followed one after the other."""
    codes: Counter[str] = Counter()
    count = 200

    def answered(_: str, line: bytes) -> None:
        codes[decode(line).get("error", {}).get("code", "ok")] += 1

    with FleetOperator(served.operator()) as operator, node.client() as client:
        moves = Client(FleetAddress(operator, "hand1"))
        moves.acquire(5.0)
        move = moves.request("move", columns=["x_mm", "y_mm"])["move"]
        key = operator.keys.do("hand1", "anna", operator.origin.session, "rows")
        begin_s = time.monotonic()
        for number in range(count):
            # The last ones are equal: in such a flood the network drops a few.
            row = [20.0 * min(number / (count - 10), 1.0), 85.0]
            operator.net.ask(key, encode({"move": move, "rows": [row]})[:-1], 10.0, answered)
        took_s = time.monotonic() - begin_s
        moves.request("end", move=move)  # it does not overtake the last row
        moves.wait(move)
        assert codes.keys() <= {"ok", "superseded"}
        # What is granted until shortly after the last one was sent; all 200 if they waited in a row.
        assert codes["ok"] <= LIVE_ROWS + 200.0 * (took_s + 0.3)
        arrives(client, "f0", (20.0, 85.0, 0.0))


def test_a_stop_by_network_ends_a_move_by_network(node: Running, served: BridgeProcess) -> None:
    with mover(served, "hand1", 5.0) as moving, FleetOperator(served.operator("bob")) as bob:
        until(lambda: "hand1" in bob.nodes(), "the node has a token")
        response = bob.ask("hand1", "hold", {}, 10.0)
        assert response is not None
        assert response["ok"]
        assert moving.wait(timeout=20) != 0
        with node.client() as client:
            assert states(client) == {"HOLD"}


def test_a_daemon_that_ends_is_found_again() -> None:
    with ExitStack() as stack:
        first = stack.enter_context(daemon())
        served = stack.enter_context(bridge({"hand1": first.socket}))
        operator = stack.enter_context(FleetOperator(served.operator()))
        until(lambda: operator.nodes() == {"hand1": 1}, "the node is there")
        first.end()
        until(lambda: operator.nodes() == {}, "its token is gone")
        again = subprocess.Popen(first.process.args, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
        try:
            until(lambda: operator.nodes() == {"hand1": 1}, "the node is there again")
            until(lambda: (operator.ask("hand1", "status", {}, 5.0) or {}).get("ok"), "it answers")
        finally:
            again.terminate()
            again.wait(timeout=30)
