"""Files of the machine: what was there is kept, and what did not come into force is named."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from contid.errors import ContidError
from contid_devices import host_files
from contid_devices.host_files import HostFile


def failing(path: Path, *commands: tuple[str, ...]) -> str:
    with pytest.raises(ContidError) as raised:
        HostFile("a test", path, "text", commands).install()
    return str(raised.value)


def test_what_was_there_is_kept_by_every_installation(tmp_path: Path) -> None:
    path = tmp_path / "x.conf"
    for text in ("the user's own", "version 1, changed by the user"):
        path.write_text(text)
        HostFile("a test", path, "of contid").install()
    assert path.read_text() == "of contid"
    assert Path(f"{path}.before").read_text() == "the user's own"
    assert Path(f"{path}.before2").read_text() == "version 1, changed by the user"


def test_a_link_stays_and_its_file_is_written(tmp_path: Path) -> None:
    own, link = tmp_path / "own.conf", tmp_path / "link.conf"
    own.write_text("before")
    link.symlink_to(own)
    HostFile("a test", link, "after").install()
    assert link.is_symlink()
    assert own.read_text() == "after"


@pytest.mark.process
def test_commands_that_failed_are_named_with_what_is_to_be_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(host_files, "COMMAND_S", 0.5)
    wrong = ("sh", "-c", "printf 'no \\377' >&2; exit 1")
    message = failing(tmp_path / "a", wrong, ("touch", str(tmp_path / "ran")), ("sleep", "60"), ("no-such",))
    assert "is written and not yet in force: sh -c" in message
    assert "no \ufffd" in message
    assert "sleep 60: no end within 0.5 s" in message
    assert "no-such: No such file" in message
    assert message.endswith(" && sleep 60 && no-such")
    assert (tmp_path / "ran").exists()


def test_what_is_no_file_is_left_alone(tmp_path: Path) -> None:
    unit, pipe = tmp_path / "contid@.service", tmp_path / "pipe"
    unit.symlink_to(os.devnull)
    os.mkfifo(pipe)
    assert "is masked; `systemctl unmask contid@.service` first" in failing(unit)
    assert str(unit.readlink()) == os.devnull
    assert "it is no file" in failing(pipe)
