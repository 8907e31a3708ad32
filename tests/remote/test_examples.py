"""The examples run as they are, against a real daemon on simulated devices."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.support.daemons import armed, daemon

pytestmark = [pytest.mark.process, pytest.mark.realtime]

EXAMPLES = Path(__file__).parents[2] / "examples"


def test_the_script_runs() -> None:
    with daemon() as running:
        asked = [sys.executable, str(EXAMPLES / "remote.py"), str(running.socket)]
        done = subprocess.run(asked, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        assert done.stdout.startswith("f0 understands x_mm, y_mm")


def test_the_notebook_runs_cell_by_cell(monkeypatch: pytest.MonkeyPatch) -> None:
    notebook = json.loads((EXAMPLES / "remote.ipynb").read_text(encoding="utf-8"))
    cells = ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "code"]
    with daemon() as running:
        monkeypatch.setattr("contid.remote.client.orders.find", lambda path: running.socket)
        with running.client() as client:
            armed(client)
        names: dict[str, Any] = {}
        try:
            for number, cell in enumerate(cells):
                exec(compile(cell, f"cell {number}", "exec"), names)
        finally:
            names["robot"].close()
        assert len(names["frames"]) == 10
