"""Drawings of a recording that cannot be made are refused, and leave nothing behind."""

from __future__ import annotations

from pathlib import Path

import pytest

from contid import Sim
from tests.session.rewrite import rewritten
from tests.support.command import contid_in

pytestmark = pytest.mark.process


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recorded") / "s.mcap"
    with Sim("finger", record=path) as sim:
        for _ in range(50):
            sim.step({"x_mm": 60.0, "y_mm": 75.0})
    return path


def test_a_refused_robot_file_is_located_in_the_session(recorded: Path, tmp_path: Path) -> None:
    path = tmp_path / "old.mcap"
    rewritten(recorded, path, lambda text: text.replace("rack_spacing_mm", "rack_gap_mm"))
    done = contid_in(tmp_path, "session", "export", path.name, "--rrd", "s.rrd")
    assert done.returncode == 2
    assert "old.mcap: its robot file is refused" in done.stderr
    assert "unknown key" in done.stderr


def test_a_drawing_of_other_robots_is_refused(recorded: Path, tmp_path: Path) -> None:
    done = contid_in(tmp_path, "session", "export", str(recorded), "--rrd", "s.rrd", "--robot", "hand")
    assert done.returncode == 2
    assert "other robots or axes than recorded" in done.stderr
    assert not any(tmp_path.iterdir())


def test_other_robots_are_refused_before_anything_is_written(recorded: Path, tmp_path: Path) -> None:
    outputs = ("--csv", "all.csv", "--rrd", "s.rrd")
    done = contid_in(tmp_path, "session", "export", str(recorded), *outputs, "--robot", "hand")
    assert done.returncode == 2
    assert not any(tmp_path.iterdir())


def test_a_robot_file_without_a_drawing_is_refused(recorded: Path, tmp_path: Path) -> None:
    done = contid_in(tmp_path, "session", "export", str(recorded), "--csv", "all.csv", "--robot", "none")
    assert done.returncode == 2
    assert "--robot is for the shapes of a viewer: for --" in done.stderr
    assert "--rrd" in done.stderr
    assert not any(tmp_path.iterdir())


def test_two_outputs_in_one_file_are_refused(recorded: Path, tmp_path: Path) -> None:
    outputs = ("--csv", "all.csv", "--parquet", "./all.csv")
    done = contid_in(tmp_path, "session", "export", str(recorded), *outputs)
    assert done.returncode == 2
    assert "--csv and --parquet name the same file: all.csv" in done.stderr
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize(("option", "name"), [("--rrd", "full.rrd"), ("--foxglove", "full.mcap")])
def test_a_full_disk_is_refused_by_name(recorded: Path, tmp_path: Path, option: str, name: str) -> None:
    (tmp_path / name).symlink_to("/dev/full")
    done = contid_in(tmp_path, "session", "export", str(recorded), option, name)
    assert (done.returncode, name in done.stderr) == (2, True)
    assert "error logging message" not in done.stderr  # of a library, for every tick
