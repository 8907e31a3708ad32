"""Workers find the files of tests compiled: in a new clone each of them would rewrite and compile every file.

All workers collect all tests at the same time, so what one of them compiles comes too late for the others.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import pytest

ROOT: Final = Path(__file__).parents[3]
#: Processes that compile; CI has two cores.
PARTS: Final = 2
#: Fewer new files are compiled by the workers: these processes import what the tests import.
MANY: Final = 100


def not_compiled(files: Sequence[Path]) -> list[Path]:
    """Those that pytest has not compiled."""
    return [file for file in files if not any((file.parent / "__pycache__").glob(f"{file.stem}.*-pytest-*"))]


def compile_files(files: Sequence[Path], folder: Path) -> None:
    """Collect files of tests in a folder, which compiles what they import as well; workers report errors."""
    command = [sys.executable, "-m", "pytest", "--collect-only", "-q", "-p", "no:cacheprovider"]
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
    shares = [files[part::PARTS] for part in range(PARTS)]
    started = [
        subprocess.Popen(
            [*command, *map(str, share)],
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for share in shares
        if share
    ]
    for process in started:
        process.wait()


@pytest.hookimpl(tryfirst=True)
def pytest_sessionstart(session: pytest.Session) -> None:
    """Compile for the workers of a whole run, before they start."""
    config = session.config
    chosen = config.args_source is pytest.Config.ArgsSource.ARGS
    if hasattr(config, "workerinput") or not config.option.numprocesses or chosen:
        return
    files = [path for top in ("tests", "extras") for path in sorted((ROOT / top).rglob("test_*.py"))]
    new = not_compiled(files)
    if len(new) >= MANY:
        compile_files(new, ROOT)
