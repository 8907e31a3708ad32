"""The study of real tendon robots, on an excerpt of one of them."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from studies.tendon_recordings import main
from tests.calibrate.tendon_recordings import excerpt_lines


@pytest.mark.campaign
def test_the_statics_predict_pairs_better_than_every_black_box(tmp_path: Path) -> None:
    """Fitted to single tendons and sections; pairs of sections stand for the file kept out."""
    lines = excerpt_lines()
    folder = tmp_path / "ftdcr_v4"
    folder.mkdir()
    files = {
        "train.csv": [line for line in lines[1:] if "pair" not in line and "dir240" not in line],
        "val.csv": [line for line in lines[1:] if "pair12" in line or "pair13" in line],
        "tendon_pull.csv": [line for line in lines[1:] if "pull" in line],
    }
    for name, rows in files.items():
        (folder / name).write_text("\n".join([lines[0], *rows]) + "\n", encoding="utf-8")
    result = CliRunner().invoke(main, [str(tmp_path), "--robot", "ftdcr_v4"])
    assert result.exit_code == 0, result.output
    first, *table = result.output.splitlines()
    assert first == f"ftdcr_v4: {len(files['train.csv'])} rows fitted, {len(files['val.csv'])} kept out [mm]"
    kept_out = {}
    for line in table[2:]:
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        found = re.match(r"([\d.]+) \(([\d.]+) to ([\d.]+)\)", cells[2])
        assert found is not None, line
        kept_out[cells[0]] = float(found[1])
    assert list(kept_out) == [
        "ridge on pulls and their products",
        "kernel ridge on pulls and play states",
        "constant curvature",
        "+ offsets",
        "+ play",
        "statics",
        "+ friction, play",
        "+ residual",
    ]
    statics = kept_out["+ friction, play"]
    others = [value for name, value in kept_out.items() if "ridge" in name or name == "constant curvature"]
    assert statics < 0.8 * min(others), kept_out
