"""Paths of sockets, the listening socket, the search for daemons."""

from __future__ import annotations

import errno
import fcntl
import grp
import os
import shutil
import socket
import stat
from contextlib import closing
from pathlib import Path

import pytest

from contid.remote.protocol import socket_path
from contid.remote.protocol.connect import default_directory
from contid.remote.protocol.socket_path import Endpoint, SocketError, default_path, find, is_listening
from contid.remote.protocol.wire import NoDaemonError


def test_a_socket_is_private_and_a_second_daemon_is_refused(own_folder: Path) -> None:
    path = own_folder / "s"
    with closing(Endpoint(path)):
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
        with pytest.raises(SocketError, match="another daemon listens"):
            Endpoint(path)
        assert is_listening(path)
    assert not path.exists()


def test_a_stale_socket_is_removed_and_another_file_is_not(own_folder: Path) -> None:
    path = own_folder / "s"
    with socket.socket(socket.AF_UNIX) as left:
        left.bind(str(path))
    assert path.exists()
    with closing(Endpoint(path)):
        assert is_listening(path)
    path.write_text("a file")
    with pytest.raises(SocketError, match="is not a socket"):
        Endpoint(path)
    assert path.read_text() == "a file"


@pytest.mark.parametrize("number", [errno.EACCES, errno.EMFILE])
def test_a_socket_that_cannot_be_looked_at_is_not_removed(
    own_folder: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    """The socket of a daemon of root, in a folder of this user, or a process without descriptors left."""

    def refused(path: Path) -> socket.socket:
        raise OSError(number, os.strerror(number))

    path = own_folder / "s"
    with closing(Endpoint(path)):
        monkeypatch.setattr(socket_path, "connect", refused)
        with pytest.raises(SocketError, match="another daemon listens"):
            Endpoint(path)
        assert path.exists()
        assert not is_listening(path, trusted=True)


def test_an_endpoint_removes_only_its_own_socket(own_folder: Path) -> None:
    path = own_folder / "s"
    first = Endpoint(path)
    path.unlink()
    second = Endpoint(path)
    first.close()
    assert path.exists()
    second.close()


def test_an_endpoint_whose_folder_was_removed_is_made_anew(
    own_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(own_folder / "1000"))
    first = Endpoint(default_path("hand.yaml"), default=True)
    assert first.again() is None
    shutil.rmtree(own_folder / "1000")
    second = first.again()
    assert second is not None
    first.close()
    with closing(second):
        assert is_listening(first.path)
        shutil.rmtree(own_folder / "1000")
        (own_folder / "1000").write_text("no folder")
        assert second.again() is None


def test_a_folder_open_to_others_is_refused(own_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(own_folder))
    (own_folder / "contid").mkdir(mode=0o755)
    (own_folder / "contid").chmod(0o755)
    with pytest.raises(SocketError, match="0700"):
        Endpoint(default_path("hand.yaml"), default=True)


def test_paths_too_long_for_a_socket_are_named(own_folder: Path) -> None:
    with pytest.raises(SocketError, match="107 bytes"):
        Endpoint(own_folder / ("s" * 200))


def test_the_only_daemon_is_found_and_several_are_listed(
    own_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(own_folder))
    monkeypatch.setattr(socket_path, "SERVICES", own_folder / "services")
    with pytest.raises(NoDaemonError, match="no daemon runs"):
        find(None)
    with closing(Endpoint(default_path("configs/hand.yaml"), default=True)) as hand:
        assert find(None) == hand.path == own_folder / "contid" / "hand.sock"
        with closing(Endpoint(default_path("arm.emulated.yaml"), default=True)) as arm:
            with pytest.raises(NoDaemonError, match="2 daemons run") as several:
                find(None)
            assert f"--socket {arm.path}" in str(several.value)
    socket_path.SERVICES.mkdir()
    with closing(Endpoint(socket_path.SERVICES / "hand.sock")) as service:
        assert find(None) == service.path


def test_without_a_runtime_folder_the_socket_is_in_a_folder_of_this_user(
    own_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    monkeypatch.setattr("tempfile.tempdir", str(own_folder))
    assert socket_path.private_directory() == own_folder / f"contid-{os.geteuid()}"
    assert stat.S_IMODE(default_directory().stat().st_mode) == 0o700


def test_only_a_named_group_is_admitted(own_folder: Path) -> None:
    group = grp.getgrgid(os.getegid()).gr_name
    for name, mode in ((None, 0o600), (group, 0o660)):
        with closing(Endpoint(own_folder / "s", group=name)) as endpoint:
            assert stat.S_IMODE(endpoint.path.stat().st_mode) == mode
            assert endpoint.path.stat().st_gid == os.getegid()
    with pytest.raises(SocketError, match="no such group"):
        Endpoint(own_folder / "s", group="no-such-group")


def test_a_folder_that_stays_locked_is_named(own_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(socket_path, "LOCK_TIMEOUT_S", 0.05)
    locked = os.open(own_folder, os.O_RDONLY)
    try:
        fcntl.flock(locked, fcntl.LOCK_SH)
        with pytest.raises(SocketError, match="holds a lock on this folder"):
            Endpoint(own_folder / "s")
    finally:
        os.close(locked)
    with closing(Endpoint(own_folder / "s")):
        pass


def test_a_group_that_a_user_is_not_of_is_named_and_no_socket_is_left(
    own_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(path: Path, user: int, group: int) -> None:
        raise PermissionError(errno.EPERM, "Operation not permitted")

    monkeypatch.setattr(os, "chown", refused)
    group = grp.getgrgid(os.getegid()).gr_name
    with pytest.raises(SocketError, match=f"only a member of group {group}"):
        Endpoint(own_folder / "s", group=group)
    assert list(own_folder.iterdir()) == []
