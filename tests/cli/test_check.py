"""``contid check``: the report, and bad files with exit code 2."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from contid.cli.check import command


def test_the_report_names_robots_axes_buses_limits_rate_and_placeholders() -> None:
    done = CliRunner().invoke(command, ["hand"])
    assert done.exit_code == 0, done.output
    for words in (
        "hand: 2 robots at 200 Hz",
        "left",
        "right",
        "servos",
        "dynamixel",
        "100",
        "id 4",
        "velocity",
    ):
        assert words in done.output
    assert "placeholders (numbers no one measured): geometry.rack_spacing_mm" in done.output


@pytest.mark.parametrize("name", ["finger", "hand"])
def test_the_report_as_json(configs: Path, name: str) -> None:
    done = CliRunner().invoke(command, [str(configs / f"{name}.yaml"), "--json"])
    report = json.loads(done.stdout)
    assert report["rate_hz"] == 200
    for robot in report["robots"]:
        assert [(axis["least"], axis["greatest"]) for axis in robot["axes"]] == [(0, 100), (0, 100)]


def test_a_bad_file_as_json_is_one_line_per_mistake(tmp_path: Path, configs: Path) -> None:
    bad = tmp_path / "bad.yaml"
    text = (configs / "finger.yaml").read_text()
    bad.write_text(text.replace("rate_hz: 200", "rate_hz: 0").replace("gap_mm: 5", "gap_mm: -5"))
    done = CliRunner().invoke(command, [str(bad), "--json"])
    assert done.exit_code == 2
    found = [json.loads(line) for line in done.stdout.splitlines()]
    lines = text.splitlines()
    wrong = [lines[each["line"] - 1] for each in found]
    assert ["rate_hz" in wrong[0], "gap_mm" in wrong[1]] == [True, True]
    assert all(each["file"] == str(bad) and each["column"] > 1 for each in found)
