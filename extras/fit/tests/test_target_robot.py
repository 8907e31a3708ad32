"""Calibrated values are written into the robot file, and nothing else of it changes."""

from __future__ import annotations

from pathlib import Path

import pytest

from contid.errors import BadInputError
from contid.robot_file.edit import Change
from contid.robot_file.load import load_named
from contid_fit.calibrate.target_robot import write_back


@pytest.mark.parametrize("ends", ["\n", "\r\n"])
def test_only_the_line_of_a_written_value_changes(tmp_path: Path, ends: str) -> None:
    text = load_named("finger").text.replace("\n", ends)
    path = tmp_path / "mine.yaml"
    path.write_bytes(text.encode())
    write_back(path, "finger", [Change("rates.velocity_mm_s", 61.5, "measured")])
    before, after = text.split(ends), path.read_bytes().decode().split(ends)
    changed = [new for old, new in zip(before, after, strict=True) if new != old]
    assert [line.split() for line in changed] == [["velocity_mm_s:", "61.5", "#", "measured"]]


def test_a_value_with_which_the_file_would_not_load_is_not_written(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(load_named("finger").text)
    before = path.read_bytes()
    with pytest.raises(BadInputError, match="velocity_mm_s"):
        write_back(path, "finger", [Change("rates.velocity_mm_s", -1.0)])
    assert path.read_bytes() == before
