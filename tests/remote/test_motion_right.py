"""Who may move the robots of a running daemon, and how the right is lost."""

from __future__ import annotations

import subprocess
import sys
import time

import pytest

from contid.client import AsyncClient, Code, RemoteError
from tests.control.fingers import circle_csv
from tests.remote.daemons import FAR, HERE, armed, daemon, states, until


def test_the_holder_that_dies_leaves_its_robots_holding() -> None:
    script = (
        "import sys, time\nfrom contid.client import AsyncClient, Client\n"
        "client = Client(sys.argv[1], name='doomed')\nclient.take(60)\n"
        "rows = ((50.0 + 5 * (step % 2), 75.0) for step in range(10**9))\n"
        "client.stream(['x_mm', 'y_mm'], rows)\n"
    )
    with daemon() as running, running.client() as client:
        armed(client)
        doomed = subprocess.Popen([sys.executable, "-c", script, str(running.socket)])
        try:
            until(lambda: states(client) == {"RUN"}, "it streams")
            with pytest.raises(RemoteError) as refused:
                client.move(HERE)
            assert refused.value.code == Code.HELD
            assert "'doomed'" in str(refused.value)
        finally:
            doomed.kill()
            doomed.wait()
        until(lambda: states(client) == {"HOLD"}, "it holds")
        assert client.status()["right"]["holder"] is None
        client.move(HERE)
        assert "lost the motion right (its connection ended)" in running.end()


def test_a_holder_that_falls_silent_loses_the_right() -> None:
    with daemon() as running, running.client(name="sleepy") as sleepy, running.client() as other:
        armed(other)
        sleepy.take(0.2)
        until(lambda: other.status()["right"]["holder"] is None, "its time is over")
        other.move(HERE)


def test_a_holder_whose_trajectory_is_being_checked_keeps_the_right() -> None:
    rows = [(0.005 * number, 50.0 + 0.0001 * number, 75.0) for number in range(20_000)]
    with daemon() as running, running.client(name="patient") as client:
        armed(client)
        client.take(0.3)  # checking takes longer
        client.stream(["t_s", "x_mm", "y_mm"], rows, wait=False)
        right = client.status()["right"]
        assert right["holder"] == "patient"
        client.release()
        assert "lost the motion right" not in running.end()


def test_everybody_may_stop_and_a_script_does_not_undo_it() -> None:
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
        script.take()
        script.move(HERE)


def test_the_input_keeps_the_right_until_somebody_takes_over() -> None:
    given = circle_csv(1, period_s=20.0)
    with daemon(1, stdin=given) as running, running.client(name="other") as client:
        until(lambda: states(client) == {"RUN"}, "it follows the input")
        with pytest.raises(RemoteError) as refused:
            client.move(HERE)
        assert refused.value.code == Code.HELD
        client.hold()
        until(lambda: states(client) == {"HOLD"}, "it pauses")
        client.resume()
        until(lambda: states(client) == {"RUN"}, "it goes on")
        assert client.take(takeover=True)["from"] == "input"
        client.move(HERE)
        time.sleep(0.1)
        assert states(client) == {"HOLD"}


async def test_whoever_iterates_telemetry_keeps_the_right_in_asyncio_too() -> None:
    with daemon() as running:
        async with AsyncClient(running.socket, name="watcher") as client:
            await client.take(1.0)
            began_s = time.monotonic()
            frames = client.telemetry(50.0, fields=["state"])
            async for _ in frames:
                if time.monotonic() - began_s > 1.5:
                    break
            await frames.aclose()  # type: ignore[attr-defined]
            assert (await client.status())["right"]["holder"] == "watcher"
