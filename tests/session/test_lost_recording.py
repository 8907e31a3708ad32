"""A recording that was asked for and is lost ends a run in real time with exit code 1."""

from __future__ import annotations

import resource
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.waiting import until

pytestmark = pytest.mark.process

ROWS = "t_s,x_mm,y_mm\n0,50,70\n1,52,70\n2,50,70\n"


def _recorder(daemon: int) -> int:
    """Process id of the recorder that a daemon started, 0 if there is none."""
    for child in Path(f"/proc/{daemon}/task/{daemon}/children").read_text().split():
        if b"contid.session.mcap_recorder" in Path(f"/proc/{child}/cmdline").read_bytes():
            return int(child)
    return 0


@pytest.mark.realtime
@pytest.mark.parametrize("full", [False, True])
def test_a_lost_recording_sets_the_exit_code_of_the_run(full: bool, tmp_path: Path) -> None:
    """The recorder's file may grow no further: the same path as a full disk, without a disk of its own."""
    (tmp_path / "rows.csv").write_text(ROWS)
    session = tmp_path / "a.mcap"
    command = ["run", "finger", "--mock", "--trajectory", "rows.csv", "--record", session.name]
    process = subprocess.Popen(
        [sys.executable, "-m", "contid", *command, "--socket", "a.sock"],
        cwd=tmp_path,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        until(lambda: session.exists() or process.poll() is not None, "the recording")
        until(lambda: session.stat().st_size > 0, "its first bytes")
        if full:
            size = session.stat().st_size
            resource.prlimit(_recorder(process.pid), resource.RLIMIT_FSIZE, (size, size))
        stdout, stderr = process.communicate(timeout=60)
    finally:
        process.kill()
        process.communicate()
    assert process.returncode == (1 if full else 0), stdout + stderr
    assert ("recording is incomplete (exit code 1)" in stdout) == full
    assert ("File too large" in stdout) == full
