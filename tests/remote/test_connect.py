"""Connecting: a full backlog is waited for, and another user's socket is not used."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path

import pytest

from contid.client import Client
from contid.remote.client.client_protocol import Request
from contid.remote.client.wires import SocketWire
from contid.remote.protocol import socket_path
from contid.remote.protocol.connect import connect
from contid.remote.protocol.socket_path import Endpoint, find
from contid.remote.protocol.wire import NoDaemonError

pytestmark = pytest.mark.process

STRANGER = 54321
LISTEN = """
import json, os, socket, sys
os.setgid({uid}); os.setuid({uid})
s = socket.socket(socket.AF_UNIX); s.bind(sys.argv[1]); os.chmod(sys.argv[1], 0o666); s.listen()
print("ready", flush=True)
while True:
    c, _ = s.accept()
    try:
        c.sendall(b'{{"event":"hello","protocol":2}}\\n')
        for line in c.makefile("rb"):
            c.sendall(b'{{"id":%d,"ok":true,"result":{{}}}}\\n' % json.loads(line)["id"])
    except OSError:
        pass
"""
needs_root = pytest.mark.skipif(os.geteuid() != 0, reason="needs root to become another user")


@contextmanager
def stranger(path: Path) -> Iterator[None]:
    """Another user listens at a path and answers like a daemon."""
    script = LISTEN.format(uid=STRANGER)
    listening = subprocess.Popen([sys.executable, "-c", script, str(path)], stdout=subprocess.PIPE)
    try:
        assert listening.stdout is not None
        assert listening.stdout.readline() == b"ready\n"
        yield
    finally:
        listening.kill()
        listening.communicate()


def test_a_full_backlog_is_waited_for(own_folder: Path) -> None:
    path = own_folder / "s"
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(path))
        listening.listen(2)
        waiting = []
        with suppress(BlockingIOError):
            while True:
                waiting.append(connect(path))
        assert waiting
        with pytest.raises(BlockingIOError):
            connect(path, 0.05)
        accepted: list[socket.socket] = []
        results: list[socket.socket] = []
        thread = threading.Thread(target=lambda: results.append(connect(path, 30.0)))
        thread.start()
        accepted += [listening.accept()[0] for _ in range(len(waiting) + 1)]
        thread.join()
        assert results[0].getpeername() == str(path)
        for connected in (*waiting, *accepted, *results):
            connected.close()


@needs_root
def test_a_socket_of_another_user_gets_no_order(own_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Any user may create the default folder first; its daemon would answer that nothing moves."""
    own_folder.chmod(0o755)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(own_folder))
    monkeypatch.setattr(socket_path, "SERVICES", own_folder / "services")
    folder = own_folder / "contid"
    folder.mkdir()
    os.chown(folder, STRANGER, STRANGER)
    path = folder / "finger.sock"
    with stranger(path):
        with pytest.raises(NoDaemonError, match="belongs to another user"):
            find(None)
        with pytest.raises(NoDaemonError, match=f"user {STRANGER} listens there"):
            Client(path)
    open_to_all = own_folder / "tmp"
    open_to_all.mkdir()
    open_to_all.chmod(0o1777)
    with stranger(open_to_all / "s"), pytest.raises(NoDaemonError, match=f"user {STRANGER}"):
        Client(open_to_all / "s")


@needs_root
def test_a_service_in_a_folder_of_its_own_is_used(own_folder: Path) -> None:
    own_folder.chmod(0o755)
    service = own_folder / "service"
    service.mkdir(mode=0o750)
    os.chown(service, STRANGER, STRANGER)
    with stranger(service / "s"), Client(service / "s") as client:
        assert client.hello == {}


@needs_root
def test_the_refusal_of_a_user_without_rights_has_the_remedy(own_folder: Path) -> None:
    own_folder.chmod(0o755)
    with closing(Endpoint(own_folder / "s")):
        os.seteuid(STRANGER)
        try:
            with pytest.raises(NoDaemonError, match="this user may not connect; join the group"):
                Client(own_folder / "s")
        finally:
            os.seteuid(0)


def test_a_request_that_was_sent_in_part_is_not_continued_by_the_next_one(own_folder: Path) -> None:
    """A daemon that stands still reads nothing: the socket fills up in the middle of a line."""
    path = own_folder / "daemon.sock"
    with closing(socket.socket(socket.AF_UNIX)) as listener:
        listener.bind(str(path))
        listener.listen()
        wire = SocketWire(path, 1.0)
        with closing(listener.accept()[0]) as daemon, closing(wire):
            with pytest.raises(TimeoutError):
                wire.send(Request(1, "note", b"1" * (4 << 20) + b"\n", 0.01, {}))
            with pytest.raises(OSError, match="pipe"):
                wire.send(Request(2, "hold", b"2\n", 0.01, {}))
            received = b"".join(iter(lambda: daemon.recv(1 << 20), b""))
        assert set(received) == {ord("1")}
