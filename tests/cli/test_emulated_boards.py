"""A robot on several boards: the sketch itself at the other end of every wire, up to the recording."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.support.command import contid_in, emulating

pytestmark = [pytest.mark.process, pytest.mark.realtime]


@pytest.mark.slow
def test_two_arms_on_four_boards_swing_their_rope(tmp_path: Path, configs: Path) -> None:
    # Four emulated boards share two cores with other tests, and the user may lack real-time priority.
    text = (configs / "chain.emulated.yaml").read_text()
    assert text.count("role: pressure}") == 4
    (tmp_path / "chain.yaml").write_text(
        text.replace("role: pressure}", "role: pressure, tolerance_ticks: 8, watchdog_ms: 500}")
    )
    rows = contid_in(tmp_path, "path", "swing", "--period", "2", "--size", "15", "--for", "chain.yaml")
    assert rows.returncode == 0, rows.stderr
    (tmp_path / "swing.csv").write_text(rows.stdout)
    with emulating(tmp_path, "chain.yaml", wire="due"):
        run = contid_in(
            tmp_path, "run", "chain.yaml", "--trajectory", "swing.csv", "--record", "s.mcap", "--json"
        )
    assert run.returncode == 0, run.stderr
    report = json.loads(run.stdout)
    for name in ("left", "right"):
        assert report["robots"][name]["tip_error_max_mm"] < 1e-3
    # The links of a chain follow from its arms; what the boards answered stands in for them.
    replayed = contid_in(tmp_path, "replay", "s.mcap")
    assert replayed.returncode == 0, replayed.stdout + replayed.stderr
