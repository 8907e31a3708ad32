"""Files of sessions: complete or absent, also after a kill, and private."""

from __future__ import annotations

import errno
import os
import signal
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from contid.control.engine.command_log import CommandLog
from contid.control.engine.wiring import record_layout
from contid.errors import ContidError
from contid.whole_file import new_file_mode, replacing
from contid_sessions.compact import compact
from tests.support.fingers import load

pytestmark = pytest.mark.process

KILLED = """
import os, signal, sys
from pathlib import Path
from contid.whole_file import replacing
with replacing(Path(sys.argv[1])) as file:
    file.write(b"new")
    file.flush()
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_killed_writer_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "s.mcap"
    path.write_bytes(b"old")
    done = subprocess.run([sys.executable, "-c", KILLED, str(path)])
    assert done.returncode == -signal.SIGKILL
    assert [each.name for each in tmp_path.iterdir()] == ["s.mcap"]
    assert path.read_bytes() == b"old"


@pytest.mark.parametrize("nameless", [True, False])
def test_a_file_is_replaced_in_one_step(
    tmp_path: Path, nameless: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not every file system makes files without a name."""
    if not nameless:
        opened = os.open

        def refusing(path: str, flags: int, mode: int = 0o777, **keys: int) -> int:
            if flags & os.O_TMPFILE == os.O_TMPFILE:
                raise OSError(errno.EOPNOTSUPP, "not supported")
            return opened(path, flags, mode, **keys)

        monkeypatch.setattr("contid.whole_file.os.open", refusing)
    path = tmp_path / "table.csv"
    with replacing(path) as file:
        file.write(b"one")
    path.chmod(0o640)
    with replacing(path) as file:
        file.write(b"two")
    assert path.read_bytes() == b"two"
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    with pytest.raises(ContidError, match="No space left"), replacing(path):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert path.read_bytes() == b"two"
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("file/table.csv", "Not a directory"),
        ("missing/table.csv", "No such file"),
        ("circle", "Too many levels of symbolic links"),
        ("circle/table.csv", "Too many levels of symbolic links"),
        # The name itself is allowed, that of the file beside it would be too long.
        ("a" * 250, "File name too long"),
        ("a" * 300, "File name too long"),
        (".", "Is a directory"),
    ],
)
def test_what_cannot_be_written_is_refused_by_its_own_name(tmp_path: Path, name: str, message: str) -> None:
    (tmp_path / "file").write_bytes(b"old")
    (tmp_path / "circle").symlink_to("circle")
    path = tmp_path / name
    with pytest.raises(ContidError) as refused, replacing(path) as file:
        file.write(b"new")
    assert str(refused.value).startswith(f"{path}: cannot write it: {message}")
    assert sorted(each.name for each in tmp_path.iterdir()) == ["circle", "file"]


def test_links_are_followed(tmp_path: Path) -> None:
    (tmp_path / "inner").mkdir()
    (tmp_path / "second").symlink_to("inner/table.csv")
    (tmp_path / "first").symlink_to("second")
    with replacing(tmp_path / "first") as file:
        file.write(b"new")
    assert (tmp_path / "inner" / "table.csv").read_bytes() == b"new"
    assert (tmp_path / "first").is_symlink()


def test_the_mode_of_new_files_is_read_without_changing_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Another thread that creates a file meanwhile would give every user the right to write it."""
    before = os.umask(0o027)
    try:
        monkeypatch.setattr(os, "umask", lambda mask: pytest.fail("changed"))
        assert new_file_mode() == 0o640
    finally:
        monkeypatch.undo()
        os.umask(before)


def test_a_session_is_for_its_owner_only(growing: Path, tmp_path: Path) -> None:
    assert stat.S_IMODE(growing.stat().st_mode) == 0o600
    assert stat.S_IMODE(compact(growing, tmp_path / "c.mcap").stat().st_mode) == 0o600


def test_a_command_log_is_new_and_private(tmp_path: Path) -> None:
    layout = record_layout(load(1), 200.0)
    path, victim, link = tmp_path / "log.csv", tmp_path / "victim", tmp_path / "link"
    CommandLog(path, layout).close()
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    victim.write_text("precious")
    link.symlink_to(victim)
    (tmp_path / "dangling").symlink_to(tmp_path / "elsewhere")
    for taken in (path, victim, link, tmp_path / "dangling"):
        with pytest.raises(ContidError, match="never overwritten"):
            CommandLog(taken, layout)
    assert victim.read_text() == "precious"
    assert not (tmp_path / "elsewhere").exists()
    with pytest.raises(ContidError, match="No such file"):
        CommandLog(tmp_path / "absent" / "log.csv", layout)
    CommandLog(Path(os.devnull), layout).close()


def test_a_command_log_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    layout = record_layout(load(1), 200.0)
    with pytest.raises(ContidError, match="/dev/full: cannot write the command log: No space left on device"):
        CommandLog(Path("/dev/full"), layout)
    pipe = tmp_path / "pipe.csv"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    log = CommandLog(pipe, layout)
    os.close(reader)
    with pytest.raises(ContidError, match=r"pipe\.csv: cannot write the command log: Broken pipe"):
        log.write([0.0] * layout.robot_start(1))
    log.close()
