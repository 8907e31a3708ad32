"""Cache of the emulator program, and the errors without a place for it."""

from __future__ import annotations

from pathlib import Path

import pytest

from contid.errors import DeviceError
from contid_drivers.due import messages
from contid_drivers.due.firmware import build_host, cache_dir


def test_a_user_without_home_folder_is_told_what_to_set(monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(Path, "home", unknown)
    with pytest.raises(DeviceError, match="set XDG_CACHE_HOME"):
        cache_dir()


def test_a_cache_that_cannot_be_made_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    with pytest.raises(DeviceError, match=r"file/contid/firmware: Not a directory.*XDG_CACHE_HOME"):
        build_host()


def test_a_board_of_the_first_protocol_is_refused_with_the_remedy():
    # Its answer to a hello of version 2: refused, wrong version, 1.
    with pytest.raises(messages.BadAnswerError, match="protocol version 1, this contid 2"):
        messages.read_answer(bytes.fromhex("01ff0701020100"))
