"""The real command in a process of its own."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).parents[2]


def contid(
    *arguments: str, stdin: str = "", folder: Path | None = None, timeout_s: float = 120.0
) -> subprocess.CompletedProcess[str]:
    """Run ``contid ARGUMENTS`` with text on stdin; stdout, stderr and the exit code come back."""
    return subprocess.run(
        [sys.executable, "-m", "contid", *arguments],
        input=stdin,
        cwd=folder,
        env=environment(),
        capture_output=True,
        text=True,
        timeout=timeout_s,
        check=False,
    )


def program(code: str, *arguments: str) -> list[str]:
    """The command of a program that imports contid; forked, where ``python -c`` would import anew."""
    return [sys.executable, "-m", "tests.support.plugins.program", code, *arguments]


def environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": os.pathsep.join((str(ROOT), str(ROOT / "drivers")))}


def contid_in(folder: Path, *arguments: str, stdin: str = "") -> subprocess.CompletedProcess[str]:
    """Run ``contid ARGUMENTS`` in a folder."""
    return contid(*arguments, stdin=stdin, folder=folder)


@contextmanager
def emulating(folder: Path, *arguments: str, wire: str = "dynamixel") -> Iterator[subprocess.Popen[str]]:
    """Run ``contid emulate`` in a folder, from its ready message on."""
    process = subprocess.Popen(
        [sys.executable, "-m", "contid", "emulate", wire, *arguments],
        cwd=folder,
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stderr is not None
    try:
        assert "ready" in process.stderr.readline()
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(10)
        process.stdout.close()
        process.stderr.close()
