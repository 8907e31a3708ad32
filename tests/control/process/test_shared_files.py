"""What is removed at the start of a daemon: the files of killed runs, and nothing of the user."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from contid.control.process import shared_files


def test_only_old_files_of_runs_are_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shared_files, "folder", lambda: tmp_path)
    names = ("contid-17-a1b2.npz", "contid-17-c3d4.ring", "contid-measured.npz", "contid-18-young.bulk")
    for name in names:
        (tmp_path / name).write_bytes(b"")
        if "young" not in name:
            before = time.time() - 2.0 * shared_files.STALE_S
            os.utime(tmp_path / name, (before, before))
    shared_files.sweep()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["contid-18-young.bulk", "contid-measured.npz"]
