"""``contid calibrate curvature``: from a CSV of markers to numbers in the robot file."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from contid.robot_file.load import load_robot_file
from contid_fit.calibrate import curvature_plot
from contid_fit.commands import command
from tests.support.command import contid
from tests.support.photographs import photograph

pytestmark = pytest.mark.process


@pytest.fixture
def data(tmp_path: Path) -> Path:
    path = tmp_path / "markers.csv"
    path.write_text(photograph(0.3))
    return path


def test_the_fit_is_written_with_its_provenance_and_nothing_else_changes(
    data: Path, tmp_path: Path, configs: Path
) -> None:
    robot_file = tmp_path / "finger.yaml"
    shutil.copy(configs / "finger.yaml", robot_file)
    before = robot_file.read_text()
    plot = tmp_path / "fit.png"
    done = contid(
        "calibrate", "curvature", str(data), "--mm-per-px", "0.2", "--write", str(robot_file),
        "--plot", str(plot),
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    finger: Any = load_robot_file(robot_file).file.robots["finger"]
    assert finger.correction.a_per_mm == pytest.approx(0.0013, abs=3e-4)
    assert finger.correction.b == pytest.approx(-0.2774, abs=0.02)
    assert finger.correction.arc_length_mm == (40, 100)
    assert "correction.arc_length_mm" not in finger.placeholder
    text = robot_file.read_text()
    assert "from markers.csv" in text
    changed = [line for line in before.splitlines() if line not in text.splitlines()]
    assert all("a_per_mm" in s or "b:" in s or "arc_length_mm" in s for s in changed), changed
    assert plot.stat().st_size > 5000


def test_a_table_of_a_spreadsheet_with_any_name_is_written_back(tmp_path: Path, configs: Path) -> None:
    """Spreadsheets begin with a byte order mark; a name may have what ends a comment of YAML."""
    robot_file, data = tmp_path / "finger.yaml", tmp_path / "mar\nkers: \u2028.csv"
    shutil.copy(configs / "finger.yaml", robot_file)
    data.write_text("\ufeff" + photograph(0.3), encoding="utf-8")
    done = contid("calibrate", "curvature", str(data), "--mm-per-px", "0.2", "--write", str(robot_file))
    assert done.returncode == 0, done.stderr
    assert "from mar?kers: ?.csv" in robot_file.read_text()
    load_robot_file(robot_file)


def test_json_carries_every_posture(data: Path) -> None:
    done = contid("calibrate", "curvature", str(data), "--mm-per-px", "0.2", "--for", "finger", "--json")
    found = json.loads(done.stdout)
    assert len(found["postures"]) == 25
    assert found["confidence"] == 0.95


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--for", "finger"], "--mm-per-px"),
        (["--mm-per-px", "0.2"], "--write FILE"),
        (["--for", "hand", "--mm-per-px", "0.2"], "choose with --robot"),
        (["--for", "stiffflop1", "--mm-per-px", "0.2"], "0 robots of kind rack finger"),
    ],
)
def test_mistakes_are_explained(data: Path, arguments: list[str], message: str) -> None:
    done = contid("calibrate", "curvature", str(data), *arguments)
    assert done.returncode == 2
    assert message in done.stderr


def test_a_figure_without_a_folder_is_refused_first_and_one_that_fails_leaves_the_fit(
    data: Path, tmp_path: Path, configs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot_file = tmp_path / "finger.yaml"
    shutil.copy(configs / "finger.yaml", robot_file)
    before = robot_file.read_text()
    arguments = ["curvature", str(data), "--mm-per-px", "0.2", "--write", str(robot_file), "--plot"]
    done = CliRunner().invoke(command, [*arguments, str(tmp_path / "none" / "fit.png")])
    assert done.exit_code == 2
    assert "there is no folder" in done.output
    assert robot_file.read_text() == before

    def fails(*_: object) -> None:
        raise OSError("the disk is full")

    monkeypatch.setattr(curvature_plot, "plot_curvature", fails)
    done = CliRunner().invoke(command, [*arguments, str(tmp_path / "fit.png")])
    assert "the disk is full" in str(done.exception)
    assert "from markers.csv" in robot_file.read_text()
