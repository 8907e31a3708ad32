"""`Client` and `AsyncClient` over the network: what holds at the socket holds here."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from contid.client import AsyncClient, Client, ConnectionLostError, RemoteError
from contid.errors import ContidError
from contid.remote.client.servo import ServoState
from contid.remote.client.wires import address_of
from contid_fleet.fleet_address import FleetAddress, OperatorAddress, await_node
from contid_fleet.net import FleetError
from contid_fleet.operator import FleetOperator
from tests.support.daemons import FAR, HERE, arrives, daemon, states
from tests.support.fleets import BridgeProcess, Fleet, bridge
from tests.support.ports import free_port
from tests.support.relay import Relay
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime]


@contextmanager
def client(lab: Fleet | BridgeProcess, node: str = "hand1", name: str = "anna") -> Iterator[Client]:
    served = lab if isinstance(lab, BridgeProcess) else lab.bridge
    with FleetOperator(served.operator(name)) as operator, Client(FleetAddress(operator, node)) as opened:
        yield opened


def test_a_session_of_a_client_by_network(lab: Fleet) -> None:
    """As `tests.remote.test_moving`, with the same methods."""
    with client(lab) as robot, lab.daemons["hand1"].client() as local:
        assert robot.describe() == local.describe()
        assert robot.hello["protocol"] == local.hello["protocol"]
        robot.move(FAR)
        arrives(local, "f0", (30.0, 85.0, 0.0))
        lease = local.status()["lease"]
        assert lease["by"] == "anna"
        assert lease["holder"] == robot.name
        live = [(30.0 + 0.1 * step, 85.0) for step in range(100)]
        assert robot.stream(["x_mm", "y_mm"], live) == []
        arrives(local, "f0", (39.9, 85.0, 0.0))
        timed = [(0.02 * step, 39.9 - 0.2 * step, 85.0) for step in range(50)]
        assert robot.stream(["t_s", "x_mm", "y_mm"], timed) == []
        report = robot.servo(50, lambda state: {"x_mm": 30.0, "y_mm": 85.0} if state.step < 25 else None)
        assert report.steps > 5
        arrives(local, "f0", (30.0, 85.0, 0.0))
        frames = robot.telemetry(100.0, fields=["state"], events=True)
        seen = [next(frames) for _ in range(20)]
        frames.close()
        ticks = [frame["tick"] for frame in seen if frame["event"] == "telemetry"]
        assert ticks == sorted(set(ticks))
        robot.stop()
        until(lambda: states(local) == {"OFF"}, "it rests")
        robot.resume()
        assert states(local) == {"HOLD"}
        robot.move(FAR)


async def test_the_asyncio_client_does_the_same(lab: Fleet) -> None:
    with FleetOperator(lab.bridge.operator()) as operator:
        async with AsyncClient(FleetAddress(operator, "hand2")) as robot:
            await robot.move(FAR)
            with lab.daemons["hand2"].client() as local:
                arrives(local, "f0", (30.0, 85.0, 0.0))
            assert await robot.stream(["x_mm", "y_mm"], [(30.0, 85.0)] * 20) == []
            with pytest.raises(RemoteError):
                await robot.move({"x_mm": 3000.0, "y_mm": 85.0})


def test_a_free_lease_is_taken_but_not_after_a_stop_of_another(lab: Fleet) -> None:
    with client(lab) as robot, lab.daemons["hand1"].client(name="person") as person:
        robot.move(FAR)
        robot.release()
        robot.resume()
        assert person.status()["lease"]["holder"] is None, "only a move keeps the lease that it takes"
        person.hold()
        with pytest.raises(RemoteError, match=r"'person'.*stopped the robots") as refused:
            robot.move(HERE)
        assert refused.value.code == "stopped"
        assert person.status()["lease"]["holder"] is None
        with pytest.raises(RemoteError, match="stopped"):
            robot.resume()
        robot.resume(after_stop=True)
        with pytest.raises(RemoteError):
            robot.move({"x_mm": 3000.0, "y_mm": 85.0})
        assert person.status()["lease"]["holder"] is None
        person.acquire()
        with pytest.raises(RemoteError, match="'person'") as refused:
            robot.move(HERE)
        assert refused.value.code == "lease-held"
        person.release()


def test_another_operator_is_not_named(lab: Fleet) -> None:
    with client(lab, name="bob") as robot:
        with pytest.raises(RemoteError, match="by: it is the operator"):
            robot.request("hello", by="anna")
        with pytest.raises(RemoteError, match="needs the right"):
            robot.move(FAR)
        assert len([frame for frame, _ in zip(robot.telemetry(50.0), range(5), strict=False)]) == 5


def test_a_bridge_that_is_killed_ends_its_clients() -> None:
    with daemon() as one, bridge({"hand1": one.socket}) as served, client(served) as robot:
        until(lambda: states(robot) == {"HOLD"}, "it is armed")
        served.process.kill()
        with pytest.raises(ConnectionLostError, match="hand1"):
            until(lambda: robot.ping() is not None, "the connection is lost")


def test_the_address_of_a_node_is_understood_by_the_commands(lab: Fleet) -> None:
    folder = lab.bridge.operator_file().parent
    (folder / "fleet.yaml").write_text((folder / "anna.yaml").read_text())

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "contid", *arguments],
            cwd=folder, capture_output=True, text=True, env={**os.environ}, check=False,
        )  # fmt: skip

    done = run("move", "--socket", "fleet:lab/hand1", "x_mm=20", "y_mm=85")
    assert done.returncode == 0, done.stderr
    with lab.daemons["hand1"].client() as local:
        arrives(local, "f0", (20.0, 85.0, 0.0))
    assert run("status", "--socket", "fleet:lab/hand2").returncode == 0
    done = run("hold", "--socket", "fleet:lab/hand2")
    assert done.stdout == "f0: HOLD\n"
    missing = run("status", "--socket", "fleet:lab/hand9")
    assert missing.returncode == 4
    assert "no node 'hand9' in this fleet; there are: hand1, hand2" in missing.stderr
    assert "is that of fleet 'lab'" in run("status", "--socket", "fleet:other/hand1").stderr
    with lab.daemons["hand2"].client() as local:
        local.resume(after_stop=True)


@pytest.mark.parametrize("text", ["fleet:", "fleet:lab", "fleet:lab/", "fleet:lab/who", "fleet:a/b/c"])
def test_what_is_no_address_is_refused(text: str) -> None:
    with pytest.raises(ContidError, match="fleet:FLEET/NODE"):
        address_of(text)


def test_addresses_and_paths() -> None:
    found = address_of("fleet:lab/hand1")
    assert isinstance(found, OperatorAddress)
    assert found.name == "fleet:lab/hand1"
    assert address_of("/run/contid/fleet:lab") is address_of(Path("s")) is address_of(None) is None


def test_a_node_that_is_not_there(lab: Fleet) -> None:
    with pytest.raises(FleetError, match="no node 'hand7'"), client(lab, "hand7"):
        pass


#: Of the link in one direction; a round trip is twice as long.
DELAY_S = 0.025


@contextmanager
def far_away(lab: Fleet) -> Iterator[tuple[Client, Client]]:
    """A client over a link with latency, and a local one."""
    port = free_port()
    node = lab.daemons["hand1"]
    with (
        bridge({"hand1": node.socket}, endpoint=f"tcp/127.0.0.1:{port}") as served,
        Relay(port, DELAY_S) as relay,
        client(BridgeProcess(served.process, served.folder, f"tcp/127.0.0.1:{relay.port}")) as robot,
        node.client() as local,
    ):
        local.resume(after_stop=True)
        yield robot, local


def test_a_long_round_trip_does_not_bound_the_rate_of_set_points(lab: Fleet) -> None:
    """One at a time there would be 21 in a second."""
    seconds = 1.5

    def controller(state: ServoState) -> dict[str, float] | None:
        return {"x_mm": 30.0 + 5.0 * state.time_s, "y_mm": 85.0} if state.time_s < seconds else None

    with far_away(lab) as (robot, local):
        robot.acquire(5.0)
        report = robot.servo(100, controller)
        assert report.steps > 1.4 * seconds / (2.0 * DELAY_S)
        assert report.refused == 0
        arrives(local, "f0", (30.0 + 5.0 * seconds, 85.0, 0.0))


def test_a_long_round_trip_does_not_bound_the_rate_of_rows(lab: Fleet) -> None:
    """Every row is followed, and rows take less than a round trip each."""
    rows = [(3000.0 if n % 10 == 9 else 30.0 + 0.05 * n, 85.0) for n in range(200)]
    with far_away(lab) as (robot, local):
        robot.acquire(5.0)
        robot.move(FAR)
        begin_s = time.monotonic()
        refused = robot.stream(["x_mm", "y_mm"], rows)
        took_s = time.monotonic() - begin_s
        assert [message.partition(":")[2].partition(":")[0] for message in refused] == [
            str(n) for n in range(10, 201, 10)
        ]
        assert took_s < 0.8 * len(rows) * 2.0 * DELAY_S
        arrives(local, "f0", (30.0 + 0.05 * 198, 85.0, 0.0))
        timed = [(0.005 * n, 39.9 - 0.001 * n, 85.0) for n in range(2000)]
        move = robot.load(["t_s", "x_mm", "y_mm"], timed)
        robot.start(move)
        robot.hold()


def test_set_points_under_way_end_with_a_stop_and_report_refusals(lab: Fleet) -> None:
    with far_away(lab) as (robot, local):
        robot.acquire(5.0)

        def out_of_reach(state: ServoState) -> dict[str, float] | None:
            far = 10 <= state.step < 40  # of those that arrive together only the newest is followed
            return {"x_mm": 3000.0 if far else 30.0, "y_mm": 85.0} if state.step < 60 else None

        report = robot.servo(100, out_of_reach)
        assert report.refused >= 1
        assert "f0" in report.messages[0]

        def stopped(state: ServoState) -> dict[str, float]:
            if state.step >= 20:  # a late period is skipped
                local.hold()
            return {"x_mm": 30.0, "y_mm": 85.0}

        with pytest.raises(RemoteError) as error:
            robot.servo(100, stopped)
        assert error.value.code in ("stopped", "refused", "no-lease", "lease-held")
        assert states(local) == {"HOLD"}


def test_a_node_that_was_reported_is_there_when_a_query_does_not_find_it(
    lab: Fleet, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A router that has just come up may answer a query without the tokens that it has reported."""
    with FleetOperator(lab.bridge.operator()) as operator:
        until(lambda: "hand1" in operator.nodes(), "hand1 is reported")
        monkeypatch.setattr(operator.net, "tokens", lambda key, timeout_s: [])
        await_node(operator, "hand1")
        key = next(iter(operator.tokens("hand1")))
        monkeypatch.setattr(operator.net, "tokens", lambda asked, timeout_s: [f"{key}x"])
        with pytest.raises(FleetError, match="2 nodes have the name 'hand1'"):
            await_node(operator, "hand1")
