"""The lease of a running daemon: acquired, released, lapsed, revoked."""

from __future__ import annotations

import subprocess
import time

import pytest

from contid.client import AsyncClient, Code, RemoteError
from tests.support.command import program
from tests.support.daemons import FAR, HERE, armed, daemon, states
from tests.support.fingers import circle_csv
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime]


def test_robots_hold_when_the_holder_dies() -> None:
    script = (
        "import sys, time\nfrom contid.client import AsyncClient, Client\n"
        "client = Client(sys.argv[1], name='doomed')\nclient.acquire(60)\n"
        "rows = ((50.0 + 5 * (step % 2), 75.0) for step in range(10**9))\n"
        "client.stream(['x_mm', 'y_mm'], rows)\n"
    )
    with daemon() as running, running.client() as client:
        armed(client)
        doomed = subprocess.Popen(program(script, str(running.socket)))
        try:
            until(lambda: states(client) == {"RUN"}, "it streams")
            with pytest.raises(RemoteError) as refused:
                client.move(HERE)
            assert refused.value.code == Code.LEASE_HELD
            assert "'doomed'" in str(refused.value)
        finally:
            doomed.kill()
            doomed.wait()
        until(lambda: states(client) == {"HOLD"}, "it holds")
        assert client.status()["lease"]["holder"] is None
        client.move(HERE)
        assert "lost the lease (its connection ended)" in running.end()


def test_who_asks_is_named_in_status_refusals_and_journal() -> None:
    with daemon() as running, running.client(name="one") as one, running.client(name="bridge") as other:
        armed(one)
        other.request("hello", by="anna\x1b[2J")
        other.acquire()
        assert one.status()["lease"]["by"] == "anna?[2J"
        with pytest.raises(RemoteError, match="'bridge' by 'anna"):
            one.move(HERE)
        for _ in range(5):
            other.hold()
        one.acquire(takeover=True)
        assert "by" not in one.status()["lease"]
        journal = running.end()
        assert "client 'bridge' by 'anna?[2J': acquire" in journal
        assert journal.count("client 'bridge' by 'anna?[2J': hold") == 1  # repeated within a second


def test_the_lease_of_a_silent_holder_lapses() -> None:
    with daemon() as running, running.client(name="sleepy") as sleepy, running.client() as other:
        armed(other)
        sleepy.acquire(0.2)
        until(lambda: other.status()["lease"]["holder"] is None, "its time is over")
        other.move(HERE)


def test_the_lease_lasts_while_a_trajectory_is_checked() -> None:
    rows = [(0.005 * number, 50.0 + 0.0001 * number, 75.0) for number in range(20_000)]
    with daemon(rate_hz=200) as running, running.client(name="patient") as client:
        armed(client)
        client.acquire(0.3)  # checking takes longer
        client.stream(["t_s", "x_mm", "y_mm"], rows, wait=False)
        assert client.status()["lease"]["holder"] == "patient"
        client.release()
        assert "lost the lease" not in running.end()


def test_any_client_may_stop_and_the_holder_must_then_acquire_again() -> None:
    with (
        daemon() as running,
        running.client(name="script") as script,
        running.client(name="person") as person,
    ):
        armed(script)
        move = script.move(FAR, wait=False)
        person.hold()
        with pytest.raises(RemoteError):
            script.wait(move)
        with pytest.raises(RemoteError) as refused:
            script.move(HERE)
        assert refused.value.code == Code.STOPPED
        assert states(person) == {"HOLD"}
        script.acquire()
        script.move(HERE)


def test_the_input_holds_the_lease_until_a_takeover() -> None:
    given = circle_csv(1, period_s=20.0)
    with daemon(1, stdin=given) as running, running.client(name="other") as client:
        until(lambda: states(client) == {"RUN"}, "it follows the input")
        with pytest.raises(RemoteError) as refused:
            client.move(HERE)
        assert refused.value.code == Code.LEASE_HELD
        client.hold()
        until(lambda: states(client) == {"HOLD"}, "it pauses")
        client.resume()
        until(lambda: states(client) == {"RUN"}, "it goes on")
        assert client.acquire(takeover=True)["from"] == "input"
        client.move(HERE)
        time.sleep(0.1)
        assert states(client) == {"HOLD"}


async def test_iterating_telemetry_keeps_the_lease_in_asyncio() -> None:
    with daemon() as running:
        async with AsyncClient(running.socket, name="watcher") as client:
            await client.acquire(1.0)
            began_s = time.monotonic()
            frames = client.telemetry(50.0, fields=["state"])
            async for _ in frames:
                if time.monotonic() - began_s > 1.5:
                    break
            await frames.aclose()
            assert (await client.status())["lease"]["holder"] == "watcher"


def test_protocol_1_is_refused_with_what_to_update() -> None:
    with daemon() as running, running.client() as client:
        with pytest.raises(
            RemoteError, match=r"protocol 1 is not supported; .* 2: update the client"
        ) as refused:
            client.request("hello", protocol=1)
        assert refused.value.code == Code.PROTOCOL


def test_the_name_of_a_client_cannot_disguise_a_message() -> None:
    with daemon() as running, running.client(name="a\u202eb\x1b[2J") as client:
        client.acquire()
        assert client.status()["lease"]["holder"] == "a?b?[2J"
