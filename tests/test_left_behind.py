"""What a test leaves behind fails that test, and none that follows."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.plugins import starter

pytestmark = pytest.mark.process

ROOT = Path(__file__).parent.parent
PLUGINS = """\
pytest_plugins = (
    "tests.support.plugins.commands", "tests.support.plugins.isolation", "tests.support.plugins.reruns",
)
"""
INI = """\
[pytest]
asyncio_mode = auto
asyncio_default_fixture_loop_scope = function
filterwarnings = error
markers =
  realtime: as in contid
  true_process: as in contid
"""
LEAVES_A_PROCESS = """
import os, subprocess, sys, time

def test_it():
    subprocess.run([sys.executable, "-m", "contid", "--version"], check=True)  # by a starter
    if not os.fork():
        time.sleep(100.0)
        os._exit(0)
"""
LEAVES_A_PIPE_ONCE = """
import subprocess, sys, pytest

tries = []

@pytest.mark.realtime
def test_it():
    tries.append(1)
    process = subprocess.Popen([sys.executable, "-c", "pass"], stdout=subprocess.PIPE, text=True)
    process.wait()
    cycle = [process]
    cycle.append(cycle)
    assert len(tries) > 1
    process.stdout.close()
"""


def outcome(folder: Path, first: str) -> str:
    """The output of a run of a test, and of one of another module after it."""
    (folder / "conftest.py").write_text(PLUGINS)
    (folder / "pytest.ini").write_text(INI)
    (folder / "test_a.py").write_text(first)
    (folder / "test_b.py").write_text("def test_it():\n    pass\n")
    environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTEST_")}
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"],
        cwd=folder,
        env={
            **environment,
            "PYTHONPATH": os.pathsep.join((str(ROOT), str(ROOT / "drivers"))),
            starter.ONLY: "contid.entry",
        },
        capture_output=True,
        text=True,
        timeout=90,
        check=False,
    )
    return done.stdout + done.stderr


def test_a_process_is_ended_and_the_starter_ends_without_it(tmp_path: Path) -> None:
    """A copy of its connection kept the starter, and with it the last test of a worker, for 300 s."""
    found = outcome(tmp_path, LEAVES_A_PROCESS)
    assert "left behind: ['child process" in found
    assert "2 passed, 1 error" in found


def test_what_a_failed_try_kept_is_no_error_of_the_next_module(tmp_path: Path) -> None:
    found = outcome(tmp_path, LEAVES_A_PIPE_ONCE)
    assert "2 passed, 2 rerun" in found, found
