"""`contid emulate` leaves no link behind, however many signals end it."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from contid.robot_file.load import configs_folder


@pytest.mark.process
@pytest.mark.parametrize("ends", [("SIGTERM",), ("SIGINT", "SIGTERM"), ("SIGHUP", "SIGTERM", "SIGTERM")])
def test_further_signals_leave_no_link_behind(tmp_path: Path, ends: tuple[str, ...]) -> None:
    text = (configs_folder() / "finger.emulated.yaml").read_text(encoding="utf-8")
    (tmp_path / "f.yaml").write_text(text, encoding="utf-8")
    command = [sys.executable, "-m", "contid", "emulate", "dynamixel", "f.yaml"]
    link = tmp_path / "finger.tty"
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        limit_s = time.monotonic() + 60.0
        while not link.is_symlink() and time.monotonic() < limit_s:
            time.sleep(0.05)
        assert link.is_symlink()
        for each in ends:
            process.send_signal(getattr(signal, each))
        assert process.wait(30.0) == 0
    assert not link.is_symlink()
