"""A run under test: its input, and what its devices did."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any


def journal(folder: Path) -> list[dict[str, Any]]:
    path = folder / "journal.jsonl"
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def feed(process: subprocess.Popen[str], rows: str) -> None:
    """The whole of stdin, and its end."""
    assert process.stdin is not None
    process.stdin.write(rows)
    process.stdin.close()
    process.stdin = None


def enabled(folder: Path) -> Callable[[], bool]:
    return lambda: any(line["event"] == "enable" for line in journal(folder))
