"""What a shell starts in tests for `contid` (support/plugins/shell.py) does what it does for a user."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from tests.support.plugins.forked import environment
from tests.support.plugins.shell import contid_for_shells

pytestmark = pytest.mark.process


def shell(folder: Path, script: str) -> subprocess.CompletedProcess[str]:
    commands = folder / "bin"
    commands.mkdir()
    with contid_for_shells(commands):
        return subprocess.run(
            ["bash", "-c", f"set -m\n{script}"],
            cwd=folder,
            env={**environment(), "PATH": f"{commands}:{os.environ['PATH']}", "XDG_RUNTIME_DIR": str(folder)},
            capture_output=True,
            text=True,
            timeout=280,
            stdin=subprocess.DEVNULL,
            check=False,
        )


def test_codes_streams_and_folders(tmp_path: Path) -> None:
    done = shell(
        tmp_path,
        "contid check none.yaml; echo code $?\n"
        "mkdir below; cd below; contid new mine --from finger -y > log; cd ..; wc -l < below/mine.yaml\n"
        "contid path circle --center 50,75 --radius 5 --period 1 --for finger"
        " | contid run finger --virtual > log; echo code $?\n"
        "contid schema | head -c 1",
    )
    assert "none.yaml" in done.stderr
    lines = done.stdout.splitlines()
    assert lines[0] == "code 2"
    assert int(lines[1]) > 10
    assert lines[2] == "code 0"
    assert done.stdout.endswith("{")
    assert done.returncode == 0


@pytest.mark.realtime
def test_signals_reach_a_job(tmp_path: Path) -> None:
    done = shell(
        tmp_path,
        "for signal in TERM INT; do\n"
        "  contid run finger --mock --socket s --on-end hold < /dev/null > log 2>&1 &\n"
        "  until contid status --socket s 2>&1 | grep -q HOLD; do sleep 0.1; done\n"
        "  kill -$signal %%; wait %%; echo code $?\n"
        "done\n"
        "contid status --socket s; echo code $?",
    )
    assert done.stdout.splitlines()[:2] == ["code 130", "code 130"], done.stdout + done.stderr
    assert "code 4" in done.stdout or "code 2" in done.stdout
