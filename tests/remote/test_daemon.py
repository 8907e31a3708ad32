"""A real daemon and real clients: what is asked for happens, and what must not happen does not."""

from __future__ import annotations

import grp
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from contid.client import AsyncClient, Client, Code, ConnectionLostError, NoDaemonError, RemoteError
from contid.remote.protocol import MAX_CLIENTS, MAX_LINE
from tests.control.fingers import circle_csv
from tests.remote.daemons import Running, armed, command, daemon, until

HERE = {"x_mm": 50.0, "y_mm": 75.0}
FAR = {"x_mm": 30.0, "y_mm": 85.0}
SILENT = "faults:\n  - {at_s: 1.0, for_s: 1.0, kind: silent, axis: f0.left}\n"


def raw(running: Running) -> socket.socket:
    connected = socket.socket(socket.AF_UNIX)
    connected.settimeout(20.0)
    connected.connect(str(running.socket))
    return connected


def states(client: Client) -> set[str]:
    return {robot["state"] for robot in client.status()["robots"].values()}


def arrives(client: Client, robot: str, tip_mm: tuple[float, ...]) -> None:
    """A move ends when the command is there; the simulated servo lags behind it."""
    until(lambda: client.status()["robots"][robot]["tip_mm"] == pytest.approx(tip_mm, abs=0.5), "it is there")


def test_a_day_with_a_client() -> None:
    with daemon(2) as running, running.client(name="day") as client:
        armed(client)
        told = client.describe()["robots"]["f0"]
        assert told["columns"][:2] == ["x_mm", "y_mm"]
        assert told["axes"]["left"] == {"lower_mm": 0.0, "upper_mm": 100.0}
        client.move({"f0.x_mm": 50.0, "f0.y_mm": 75.0, "f1.x_mm": 50.0, "f1.y_mm": 80.0})
        arrives(client, "f0", (50.0, 75.0, 0.0))
        arrives(client, "f1", (50.0, 80.0, 0.0))
        status = client.status()
        assert status["right"]["holder"] == "day"
        assert status["buses"]["bus0"]["tier"] in {"fresh", "late"}
        live = [(50.0 + 0.02 * step, 75.0) for step in range(50)]
        assert client.stream(["f0.x_mm", "f0.y_mm"], live) == []
        arrives(client, "f0", (50.98, 75.0, 0.0))
        timed = [(0.02 * step, 50.98 - 0.02 * step, 75.0) for step in range(50)]
        assert client.stream(["t_s", "f0.x_mm", "f0.y_mm"], timed) == []
        frames = client.telemetry(100.0, robots="f0", fields=["state", "tip_mm"], events=True)
        seen = [next(frames) for _ in range(8)]
        ticks = [frame["tick"] for frame in seen if frame["event"] == "telemetry"]
        assert ticks == sorted(set(ticks))
        frames.close()  # type: ignore[attr-defined]
        client.stop()
        until(lambda: states(client) == {"OFF"}, "every robot rests")
        client.resume()
        assert states(client) == {"HOLD"}, "a move that ended is not taken up again"
        client.estop()
        until(running.off, "every device is without torque")
        report = json.loads(_ended(running))
    assert report["exit_code"] == 130


def _ended(running: Running) -> str:
    running.process.send_signal(signal.SIGTERM)
    out, _ = running.process.communicate(timeout=30)
    return out


def test_targets_that_are_wrong_or_out_of_reach_are_named_and_nothing_moves() -> None:
    with daemon() as running, running.client() as client:
        armed(client)
        before = client.status()["robots"]["f0"]["tip_mm"]
        for target, code in (
            ({"x_mm": 500.0, "y_mm": 75.0}, Code.UNREACHABLE),
            ({"x_mm": 50.0}, Code.BAD_TARGET),
            ({"z_mm": 50.0}, Code.BAD_TARGET),
            ({"x_mm": "far", "y_mm": 75.0}, Code.BAD_TARGET),
            ({}, Code.BAD_TARGET),
        ):
            with pytest.raises(RemoteError) as refused:
                client.move(target)  # type: ignore[arg-type]
            assert refused.value.code == code
        with pytest.raises(RemoteError) as refused:
            client.stream(["t_s", "x_mm", "y_mm"], [(0.0, 50.0, 75.0), (1.0, 500.0, 75.0)])
        assert refused.value.code == Code.BAD_TARGET
        assert "rows:3" in str(refused.value)
        with pytest.raises(RemoteError) as refused:
            client.hold("thumb")
        assert refused.value.code == Code.UNKNOWN_ROBOT
        assert client.status()["robots"]["f0"]["tip_mm"] == pytest.approx(before, abs=0.5)
        client.estop()
        with pytest.raises(RemoteError) as refused:
            client.move(HERE)
        assert refused.value.code == Code.NOT_ARMED


def test_a_fault_says_everything_latches_and_is_cleared_without_motion() -> None:
    with daemon(options=SILENT) as running, running.client() as client:
        armed(client)
        until(lambda: states(client) == {"FAULT"}, "the axis falls silent")
        fault = client.status()["robots"]["f0"]["fault"]
        assert (fault["number"], fault["name"]) == (102, "axis-silent")
        assert "f0.left did not answer" in fault["what"]
        assert all(fault[key] for key in ("cause", "reaction", "remedy"))
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
        refusals: list[str] = []
        while states(client) == {"FAULT"}:
            try:
                client.clear_fault()
            except RemoteError as error:
                refusals.append(str(error))
        assert refusals
        assert "silent" in refusals[0] or "does not answer" in refusals[0]
        assert states(client) == {"READY"}
        assert client.status()["robots"]["f0"]["enabled"] is False
        client.resume()
        assert states(client) == {"HOLD"}


def test_the_holder_that_dies_leaves_its_robots_holding() -> None:
    script = (
        "import sys, time\nfrom contid.client import Client\n"
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


@pytest.mark.parametrize("way", ["estop", "second Ctrl-C"])
@pytest.mark.parametrize("when", ["APPROACH", "RUN", "HOLD", "STOPPING"])
def test_torque_is_off_at_once_in_every_state(way: str, when: str) -> None:
    """Proof: the journal of the devices; the tick itself is in tests/control/test_orders.py."""
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


def test_an_estop_that_is_not_understood_stops_everybody() -> None:
    with daemon() as running, running.client() as client:
        armed(client)
        with pytest.raises(RemoteError, match="all robots were stopped"):
            client.request("estop", robots=["thumb"])
        assert running.off()


def test_a_client_that_floods_stalls_or_talks_garbage_blocks_no_stop() -> None:
    with daemon() as running, running.client() as client:
        armed(client)
        stalled = raw(running)
        stalled.sendall(b'{"id":1,"verb":"subscribe","rate_hz":200,"events":true}\n' * 50)
        flood = raw(running)
        flood.setblocking(False)
        garbage = raw(running)
        garbage.setblocking(False)
        long = raw(running)
        for connected, data in ((flood, b'{"verb":"status"}\n' * 2000), (garbage, os.urandom(1 << 18))):
            for _ in range(20):
                try:
                    connected.send(data)
                except OSError:
                    break
        with suppress(OSError):
            long.sendall(b'{"verb":"' + b"x" * 4 * MAX_LINE)
        client.estop()
        assert running.off()
        assert states(client) == {"OFF"}
        assert client.resume()
        for connected in (stalled, flood, garbage, long):
            connected.close()
        until(lambda: client.status()["clients"] == 1, "the others are gone")
        assert running.end() is not None


def test_a_line_that_is_too_long_and_much_garbage_end_the_connection() -> None:
    with daemon() as running:
        for data in (b"x" * (2 * MAX_LINE), b"garbage\n" * 200):
            with raw(running) as connected:
                answers = b""
                try:
                    connected.sendall(data)
                    while chunk := connected.recv(1 << 16):
                        answers += chunk
                except ConnectionError:
                    pass
                assert b"bad-request" in answers
        with running.client() as client:
            assert client.status()["clients"] == 1


def test_clients_that_connect_and_vanish_leave_nothing_and_one_more_always_gets_in() -> None:
    import psutil

    with daemon() as running, running.client(name="old") as client:
        armed(client)
        client.take(60)
        process = psutil.Process(running.process.pid)
        before = process.num_fds()
        for _ in range(50):
            with raw(running) as connected:
                connected.sendall(b'{"verb":"subscribe","rate_hz":100}\n{"verb":"sta')
        until(lambda: client.status()["clients"] == 1 and process.num_fds() <= before, "they are gone")
        many = [raw(running) for _ in range(MAX_CLIENTS + 5)]
        with running.client() as person:
            person.estop()
            assert running.off()
            assert person.status()["clients"] <= MAX_CLIENTS
            client.ping()  # the holder is never the one that has to go
        for connected in many:
            connected.close()


def test_rows_beyond_the_credit_are_refused_and_credit_comes_back() -> None:
    with daemon() as running, running.client() as client:
        armed(client)
        begun = client.request("move", columns=["x_mm", "y_mm"])
        with pytest.raises(RemoteError) as refused:
            client.request("rows", move=begun["move"], rows=[[50.0, 75.0]] * (begun["credits"] + 1))
        assert refused.value.code == Code.NO_CREDIT
        told = client.request("rows", move=begun["move"], rows=[[50.0, 75.0], [500.0, 75.0]])
        assert "out of reach" in told["refused"][0]
        refusals = client.stream(["x_mm", "y_mm"], ((50.0, 75.0) for _ in range(100)))
        assert refusals == []


def test_another_user_is_refused() -> None:
    """The file's mode keeps others out; with the mode opened the kernel's word does."""
    if os.geteuid() != 0:
        pytest.skip("needs root to become somebody else")
    script = (
        "import os, socket, sys\nos.setgid(65534)\nos.setuid(65534)\n"
        "s = socket.socket(socket.AF_UNIX)\n"
        "try:\n    s.connect(sys.argv[1])\nexcept OSError as e:\n    print(type(e).__name__)\nelse:\n"
        "    print(s.recv(1000).decode())\n"
    )

    def as_nobody(path: Path) -> str:
        asked = [sys.executable, "-c", script, str(path)]
        return subprocess.run(asked, capture_output=True, text=True, check=True).stdout

    with daemon() as running:
        running.folder.chmod(0o755)
        assert as_nobody(running.socket).strip() == "PermissionError"
        running.socket.chmod(0o666)
        said = as_nobody(running.socket)
        assert "belongs to another user" in said
        assert "hello" not in said
        with running.client() as client:
            assert client.status()["clients"] == 1


def test_a_member_of_the_sockets_group_may_give_orders() -> None:
    """The group is one that only root's child below is put into; without it the same user is refused."""
    if os.geteuid() != 0:
        pytest.skip("needs root to become somebody else")
    group = grp.getgrall()[-1]
    script = (
        "import os, sys\nfrom contid.client import Client\nfrom contid.errors import ContidError\n"
        "os.setgroups([int(g) for g in sys.argv[2:]])\nos.setgid(54321)\nos.setuid(54321)\n"
        "try:\n    with Client(sys.argv[1]) as client:\n        print(client.hold()['robots'])\n"
        "except ContidError as e:\n    print(type(e).__name__)\n"
    )

    def as_somebody(path: Path, *groups: int) -> str:
        asked = [sys.executable, "-c", script, str(path), *map(str, groups)]
        return subprocess.run(asked, capture_output=True, text=True, check=True).stdout.strip()

    with daemon(1, "--socket-group", group.gr_name) as running, running.client() as client:
        armed(client)
        running.folder.chmod(0o755)
        assert as_somebody(running.socket) == "NoDaemonError"
        assert as_somebody(running.socket, group.gr_gid) == "{'f0': 'HOLD'}"
        running.socket.chmod(0o666)
        assert as_somebody(running.socket) == "ConnectionLostError"


def test_a_second_daemon_for_the_same_socket_is_refused() -> None:
    with daemon() as running:
        robot = running.folder / "fingers.yaml"
        done = subprocess.run(
            command("run", str(robot), "--socket", str(running.socket)),
            stdin=subprocess.DEVNULL, capture_output=True, text=True,
        )  # fmt: skip
        assert done.returncode == 2
        assert "another daemon listens" in done.stderr
        with running.client() as client:
            armed(client)


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


async def test_the_asyncio_client_does_the_same() -> None:
    with daemon() as running:
        async with AsyncClient(running.socket, name="async") as client:
            with running.client() as other:
                armed(other)
            await client.move(HERE)

            async def rows() -> Any:
                for step in range(40):
                    yield (50.0 + 0.02 * step, 75.0)

            assert await client.stream(["x_mm", "y_mm"], rows()) == []
            seen = []
            frames = client.telemetry(100.0, fields=["tip_mm"])
            async for frame in frames:
                seen.append(frame["robots"]["f0"]["tip_mm"])
                if len(seen) == 3:
                    break
            await frames.aclose()  # type: ignore[attr-defined]
            assert all(len(tip) == 3 for tip in seen)
            await client.estop()
            assert running.off()
            running.process.send_signal(signal.SIGTERM)
            running.process.wait(30)
            with pytest.raises(ConnectionLostError):
                await client.ping()


def test_the_commands_talk_to_the_daemon() -> None:
    with daemon() as running, running.client() as client:
        armed(client)
        client.release()

        def contid(*arguments: str, stdin: str = "") -> subprocess.CompletedProcess[str]:
            asked = [*command(*arguments), "--socket", str(running.socket)]
            return subprocess.run(asked, capture_output=True, text=True, input=stdin)

        assert contid("move", "f0", "x_mm=50", "y_mm=75").returncode == 0
        shown = contid("status")
        assert shown.returncode == 0
        assert re.search(r"f0  HOLD  tip \(", shown.stdout)
        assert "bus0" in shown.stdout
        assert json.loads(contid("status", "--json").stdout)["robots"]["f0"]["state"] == "HOLD"
        rows = "t_s,x_mm,y_mm\n0,50,75\n0.5,51,75\n"
        followed = contid("move", "--trajectory", "-", stdin=rows)
        assert followed.returncode == 0, followed.stderr
        wrong = contid("move", "x_mm=500", "y_mm=75")
        assert wrong.returncode == 2
        assert "out of reach" in wrong.stderr
        assert contid("hold").stdout == "f0: HOLD\n"
        assert contid("estop", "f0").stdout == "f0: OFF\n"
        assert contid("resume", "--json").returncode == 0
        assert contid("clear-fault").returncode == 0
        assert contid("stop", "--end").returncode == 0
        assert running.process.wait(30) == 130
        assert contid("status").returncode == 2
