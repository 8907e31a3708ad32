"""A simulated robot with a journal, and commands that are ended after the test."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.support.fingers import fingers


@pytest.fixture
def robot(tmp_path: Path) -> Callable[..., Path]:
    """A robot file whose simulated bus keeps a journal of what its devices did."""

    def write(count: int = 1, options: str = "", **keys: Any) -> Path:
        path = tmp_path / "fingers.yaml"
        lines = f"journal_file: {tmp_path / 'journal.jsonl'}\n{options}"
        path.write_text(fingers(count, options=lines, **keys))
        return path

    return write


@pytest.fixture
def runtime_folder(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The runtime folder of this user, short enough for the path of a socket."""
    with tempfile.TemporaryDirectory(prefix="contid-") as folder:
        monkeypatch.setenv("XDG_RUNTIME_DIR", f"{folder}/1000")
        yield Path(folder) / "1000"


@pytest.fixture
def started() -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Start `contid run`; whatever is left of it afterwards is ended."""
    running: list[subprocess.Popen[str]] = []

    def start(*arguments: str) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [sys.executable, "-m", "contid", "run", *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        running.append(process)
        return process

    yield start
    for process in running:
        process.kill()
        process.communicate()
