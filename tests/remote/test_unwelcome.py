"""Clients that flood, talk garbage, vanish, or have no business here cost the others nothing."""

from __future__ import annotations

import grp
import json
import os
import resource
import socket
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from contid.client import RemoteError
from contid.remote.protocol.wire import MAX_CLIENTS
from contid.units import MAX_LINE
from tests.support.command import program
from tests.support.daemons import armed, command, daemon, raw, states
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime]


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


def test_heavy_requests_of_many_clients_are_refused_and_block_no_stop() -> None:
    columns = json.dumps([f"x_m{number}" for number in range(6000)])
    heavy = f'{{"id":1,"verb":"move","columns":{columns}}}\n'.encode()
    with daemon() as running, running.client() as client:
        armed(client)
        crowd = [raw(running) for _ in range(6)]
        for connected in crowd:
            connected.setblocking(False)
            for _ in range(10):
                with suppress(OSError):
                    connected.send(heavy)
        client.estop()
        assert running.off()
        with pytest.raises(RemoteError, match="5000 columns; a move has at most 500"):
            client.request("move", columns=["x"] * 5000)
        with pytest.raises(RemoteError, match="5000 columns"):
            client.request("move", target={f"x{number}": "" for number in range(5000)})
        with pytest.raises(RemoteError, match="unknown column") as refused:
            client.request("move", columns=["x"] * 400)
        assert str(refused.value).count("\n") < 20
        begun = client.request("subscribe", robots=["f0"] * 2000, fields=["tip_mm"] * 2000)
        assert (begun["robots"], begun["fields"]) == (["f0"], ["tip_mm"])
        for connected in crowd:
            connected.close()


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
        client.acquire(60)
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


def test_clients_that_send_nothing_displace_none_that_does() -> None:
    with daemon() as running, running.client() as client:
        for _ in range(3):
            many = [raw(running) for _ in range(MAX_CLIENTS + 5)]
            assert client.status()["clients"] <= MAX_CLIENTS
            for connected in many:
                connected.close()


def test_a_daemon_without_descriptors_is_stopped() -> None:
    """Idle clients take every descriptor of the process; the stop of a person still gets in."""
    with daemon() as running, running.client() as client:
        armed(client)
        resource.prlimit(running.process.pid, resource.RLIMIT_NOFILE, (40, 40))
        crowd = []
        for _ in range(60):
            connected = socket.socket(socket.AF_UNIX)
            connected.setblocking(False)
            with suppress(OSError):
                connected.connect(str(running.socket))
            crowd.append(connected)
        done = subprocess.run(
            command("estop", "--socket", str(running.socket)), capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
        assert running.off()
        for connected in crowd:
            connected.close()


def test_another_user_is_refused() -> None:
    """The file's mode keeps others out; with the mode opened the kernel's word does."""
    if os.geteuid() != 0:
        pytest.skip("needs root to become another user")
    script = (
        "import os, socket, sys\nos.setgid(65534)\nos.setuid(65534)\n"
        "s = socket.socket(socket.AF_UNIX)\n"
        "try:\n    s.connect(sys.argv[1])\nexcept OSError as e:\n    print(type(e).__name__)\nelse:\n"
        "    print(s.recv(1000).decode())\n"
    )

    def as_other_user(path: Path) -> str:
        asked = [sys.executable, "-c", script, str(path)]
        return subprocess.run(asked, capture_output=True, text=True, check=True).stdout

    with daemon() as running:
        running.folder.chmod(0o755)
        assert as_other_user(running.socket).strip() == "PermissionError"
        running.socket.chmod(0o666)
        output = as_other_user(running.socket)
        assert "belongs to another user" in output
        assert "hello" not in output
        with running.client() as client:
            assert client.status()["clients"] == 1


def test_a_member_of_the_sockets_group_may_give_orders() -> None:
    """The group is one that only root's child below is put into; without it the same user is refused."""
    if os.geteuid() != 0:
        pytest.skip("needs root to become another user")
    group = grp.getgrall()[-1]
    script = (
        "import os, sys\nfrom contid.client import Client\nfrom contid.errors import ContidError\n"
        "os.setgroups([int(g) for g in sys.argv[2:]])\nos.setgid(54321)\nos.setuid(54321)\n"
        "try:\n    with Client(sys.argv[1]) as client:\n        print(client.hold()['robots'])\n"
        "except ContidError as e:\n    print(type(e).__name__)\n"
    )

    def as_member(path: Path, *groups: int) -> str:
        asked = program(script, str(path), *map(str, groups))
        return subprocess.run(asked, capture_output=True, text=True, check=True).stdout.strip()

    with daemon(1, "--socket-group", group.gr_name) as running, running.client() as client:
        armed(client)
        running.folder.chmod(0o755)
        assert as_member(running.socket) == "NoDaemonError"
        assert as_member(running.socket, group.gr_gid) == "{'f0': 'HOLD'}"
        running.socket.chmod(0o666)
        assert as_member(running.socket) == "ConnectionLostError"


def test_a_member_of_the_watch_group_only_reads_and_stops() -> None:
    if os.geteuid() != 0:
        pytest.skip("needs root to become another user")
    mover, watcher = grp.getgrall()[-2:]
    script = (
        "import os, sys\nfrom contid.client import Client, RemoteError\n"
        "os.setgroups([int(sys.argv[2])])\nos.setgid(54321)\nos.setuid(54321)\n"
        "with Client(sys.argv[1]) as client:\n"
        "    verbs = ['status', 'hold', 'estop', 'acquire', 'clear_fault', 'move', 'measure']\n"
        "    for verb in [*verbs, 'stop']:\n"
        "        try:\n"
        "            client.request(verb, end=True if verb == 'stop' else None)\n"
        "            print(verb)\n"
        "        except RemoteError as error:\n"
        "            print(error.code)\n"
    )

    def as_member(path: Path, group: int) -> list[str]:
        asked = program(script, str(path), str(group))
        return subprocess.run(asked, capture_output=True, text=True, check=True).stdout.split()

    with daemon(1, "--watch-group", watcher.gr_name) as running, running.client() as client:
        armed(client)
        running.folder.chmod(0o755)
        assert running.socket.stat().st_mode & 0o777 == 0o660
        assert as_member(running.socket, watcher.gr_gid) == ["status", "hold", "estop", *["forbidden"] * 5]
        assert states(client) == {"OFF"}
    both = ("--socket-group", mover.gr_name, "--watch-group", watcher.gr_name)
    with daemon(1, *both) as running, running.client() as client:
        armed(client)
        running.folder.chmod(0o755)
        assert as_member(running.socket, watcher.gr_gid)[3:] == ["forbidden"] * 5
        assert as_member(running.socket, mover.gr_gid)[3] == "acquire"


def test_an_unknown_watch_group_is_refused() -> None:
    with daemon() as running:
        arguments = ["run", str(running.folder / "fingers.yaml"), "--watch-group", "no-such-group"]
        done = subprocess.run(
            command(*arguments), stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False
        )
        assert done.returncode == 2
        assert "--watch-group no-such-group: no such group" in done.stderr


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
