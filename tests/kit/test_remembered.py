"""Where a host keeps what it remembers of devices: a place is found whatever the user is."""

from __future__ import annotations

import os
import pwd
from pathlib import Path

import pytest

from contid.kit.remembered import BusMemory, state_folder


def test_a_user_without_a_home_opens_a_bus(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a container that runs under a number without a name: it ended in a traceback."""
    for name in ("HOME", "XDG_STATE_HOME", "STATE_DIRECTORY"):
        monkeypatch.delenv(name, raising=False)

    def unknown(uid: int) -> pwd.struct_passwd:
        raise KeyError(uid)

    monkeypatch.setattr(pwd, "getpwuid", unknown)
    assert state_folder() == Path("/var/lib/contid/buses")
    assert BusMemory("servos", "/dev/ttyUSB0", []).path.parent == state_folder()


@pytest.mark.parametrize(
    ("environment", "folder"),
    [
        ({"HOME": "/home/eva"}, "/home/eva/.local/state/contid/buses"),
        ({"HOME": "/home/eva", "XDG_STATE_HOME": "/s"}, "/s/contid/buses"),
        ({"HOME": "/home/eva", "XDG_STATE_HOME": "state"}, "/home/eva/.local/state/contid/buses"),
        ({"HOME": "/home/eva", "STATE_DIRECTORY": "/var/lib/contid:/x"}, "/var/lib/contid/buses"),
    ],
)
def test_the_folder_does_not_depend_on_where_a_command_runs(
    environment: dict[str, str], folder: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name in ("HOME", "XDG_STATE_HOME", "STATE_DIRECTORY"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    monkeypatch.chdir(tmp_path)
    assert os.fspath(state_folder()) == folder
