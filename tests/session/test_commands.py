"""``contid session`` and ``contid replay`` as a user meets them."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner

from contid.cli.main import cli
from contid.errors import ContidError
from contid.session.read import Session
from tests.cli.command import contid
from tests.control.fingers import circle_csv, fingers


def _run(*arguments: object, code: int = 0) -> str:
    result = CliRunner().invoke(cli, [str(each) for each in arguments], catch_exceptions=False)
    assert result.exit_code == code, result.output
    return result.output


def test_info(recorded: Path) -> None:
    assert "clean" in _run("session", "info", recorded)
    assert json.loads(_run("session", "info", recorded, "--json"))["state"] == "clean"


def test_export_to_tables(recorded: Path, tmp_path: Path) -> None:
    assert len(_run("session", "export", recorded, "--csv", tmp_path / "out").splitlines()) == 6
    _run("session", "export", recorded, "--csv", tmp_path / "all.csv")
    assert (tmp_path / "all.csv").stat().st_size > 10_000
    assert "--csv FOLDER" in contid("session", "export", str(recorded)).stderr


def test_repair(growing: Path, recorded: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(growing.read_bytes()[:-5000])
    assert "cut off" in _run("session", "info", cut)
    said = _run("session", "repair", cut)
    assert "clean, repaired" in said
    assert "nothing to repair" in _run("session", "repair", cut)
    assert "nothing to repair" in _run("session", "repair", recorded)
    copy = tmp_path / "copy.mcap"
    shutil.copy(cut, copy)
    _run("session", "repair", copy, "--output", tmp_path / "other.mcap")
    assert copy.read_bytes() == cut.read_bytes()
    assert "bit for bit" in _run("replay", tmp_path / "other.mcap")


def test_replay_of_another_robot_file(recorded: Path, tmp_path: Path) -> None:
    changed = tmp_path / "changed.yaml"
    text = fingers(2).replace("rack_spacing_mm: 13", "rack_spacing_mm: 13.000001", 1)
    changed.write_text(text)
    said = _run("replay", recorded, "--robot", changed, code=1)
    assert "robot file: robots.f0.geometry.rack_spacing_mm: 13 -> 13.000001" in said
    assert "first divergence: tick " in said
    assert "last equal state: tick " in said
    found = json.loads(_run("replay", recorded, "--robot", changed, "--json", code=1))
    assert found["same"] is False
    assert found["divergence"]["where"].startswith("f0.")
    assert found["divergence"]["last_equal"]["tick"] == found["divergence"]["tick"] - 1
    assert "within the tolerance" in _run("replay", recorded, "--robot", changed, "--tolerance", "1e-4")


def test_recorded_commands_go_to_buses(tmp_path: Path) -> None:
    """The buses here are simulated ones in real time; the way is the one to the wire."""
    robot, rows, path = tmp_path / "r.yaml", tmp_path / "t.csv", tmp_path / "s.mcap"
    journal = tmp_path / "journal.jsonl"
    robot.write_text(fingers(2, options=f"journal_file: {journal}"))
    rows.write_text(circle_csv(2, period_s=0.5))
    _run("run", robot, "--virtual", "--trajectory", rows, "--record", path)
    journal.unlink()
    done = contid("replay", str(path), "--hardware", "--json")
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert {name: told["fault"] for name, told in report["robots"].items()} == {"f0": 0, "f1": 0}
    assert report["robots"]["f0"]["ticks_followed"] > 100
    assert '"enable"' in journal.read_text()


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("name: fingers", "name: others", "name: 'fingers' -> 'others'"),
        ("length_mm: [0, 100]", "length_mm: [0, 90]", "robots.f0.limits.length_mm.1: 100 -> 90"),
        ("velocity_mm_s: 100", "velocity_mm_s: 50", "robots.f0.rates.velocity_mm_s: 100 -> 50"),
        ("mm_per_rev: 37.7", "mm_per_rev: 30", "robots.f0.axes.left.mm_per_rev: 37.7 -> 30"),
        ("  f1:", "  f2:", "robots.f1.model: 'rack_finger' -> absent"),
    ],
)
def test_another_robot_is_not_sent_the_commands(
    recorded: Path, tmp_path: Path, old: str, new: str, named: str
) -> None:
    other = tmp_path / "other.yaml"
    journal = tmp_path / "journal.jsonl"
    other.write_text(fingers(2, options=f"journal_file: {journal}").replace(old, new, 1))
    arguments = ["replay", str(recorded), "--hardware", "--robot", str(other)]
    with pytest.raises(ContidError, match="not the robot that was recorded") as refused:
        CliRunner().invoke(cli, arguments, catch_exceptions=False)
    assert named in str(refused.value)
    assert not journal.exists()


def test_geometry_has_no_say_in_what_hardware_is_sent(recorded: Path) -> None:
    from contid.description.load import parse_robot_file
    from contid.session.differences import refuse_another_robot

    session = Session(recorded)
    text = session.about["robot_file"]["text"]
    moved = parse_robot_file(text.replace("tip_length_mm: 22", "tip_length_mm: 21"), "moved.yaml")
    refuse_another_robot(session.robot_file(), moved)
