"""The commands ``contid session`` and ``contid replay``."""

from __future__ import annotations

import errno
import json
import os
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner

from contid.cli.main import cli
from contid.errors import ContidError
from contid.session.read import Session
from tests.session.rewrite import rewritten
from tests.support.command import contid
from tests.support.fingers import circle_csv, fingers

pytestmark = pytest.mark.process


def _run(*arguments: object, code: int = 0) -> str:
    result = CliRunner().invoke(cli, [str(each) for each in arguments], catch_exceptions=False)
    assert result.exit_code == code, result.output
    return result.output


def test_info(recorded: Path) -> None:
    assert "clean" in _run("session", "info", recorded)
    assert json.loads(_run("session", "info", recorded, "--json"))["state"] == "clean"


def test_export_to_tables(recorded: Path, tmp_path: Path) -> None:
    assert len(_run("session", "export", recorded, "--csv", tmp_path / "out").splitlines()) == 7
    _run("session", "export", recorded, "--csv", tmp_path / "all.csv")
    table = (tmp_path / "all.csv").read_bytes()
    assert table.count(b"\n") == 1 + len(list(Session(recorded).ticks()))
    assert b"\r" not in table
    _run("session", "export", recorded, "--csv", tmp_path / "all.csv")
    assert (tmp_path / "all.csv").read_bytes() == table
    assert sorted(path.name for path in tmp_path.iterdir()) == ["all.csv", "out"]
    assert "--csv FOLDER" in contid("session", "export", str(recorded)).stderr


def test_the_robot_file_is_exported_unchanged(recorded: Path, tmp_path: Path) -> None:
    path = tmp_path / "robot.yaml"
    _run("session", "export", recorded, "--yaml", path)
    assert path.read_text() == fingers(2)
    assert "bit for bit" in _run("replay", recorded, "--robot", path)
    path.write_text("mine")
    with pytest.raises(ContidError, match="never overwritten"):
        _run("session", "export", recorded, "--yaml", path)
    assert path.read_text() == "mine"


@pytest.mark.parametrize("option", ["--csv", "--hdf5", "--yaml"])
def test_an_export_never_replaces_a_recording(recorded: Path, tmp_path: Path, option: str) -> None:
    session, other = tmp_path / "mine.csv", tmp_path / "other.csv"
    for path in (session, other):
        shutil.copy(recorded, path)
    for path in (session, other):
        with pytest.raises(ContidError, match="never overwritten"):
            _run("session", "export", session, option, path)
        assert path.read_bytes() == recorded.read_bytes()
    with pytest.raises(ContidError, match="never overwritten"):
        _run("session", "repair", session, "--output", other)
    assert other.read_bytes() == recorded.read_bytes()


def test_no_incomplete_table_is_left(recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A full disk while a table is written: the old table is unchanged."""
    from contid_sessions import csv_files

    def full(*_: object) -> list[object]:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    table = tmp_path / "all.csv"
    table.write_text("before")
    monkeypatch.setattr(csv_files, "_writer", full)
    for target in (table, tmp_path / "out"):
        with pytest.raises(ContidError, match="cannot write it: No space left"):
            _run("session", "export", recorded, "--csv", target)
    assert table.read_text() == "before"
    assert not any((tmp_path / "out").iterdir())


@pytest.mark.parametrize("name", ["-", ""])
@pytest.mark.parametrize(
    ("arguments", "option"),
    [(("session", "export", "SESSION"), "--csv"), (("session", "export", "SESSION"), "--hdf5"),
     (("session", "repair", "SESSION"), "--output"), (("run", "hand", "--virtual"), "--record")],
)  # fmt: skip
def test_standard_output_is_refused(
    recorded: Path, arguments: tuple[str, ...], option: str, name: str, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    message = [str(recorded) if each == "SESSION" else each for each in arguments]
    assert f"'{option}': {name!r} names no file" in _run(*message, option, name, code=2)
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("content", "message"),
    [(b"", "empty"), (b"t_s,x_mm\n", "not an MCAP file"), (b"\x89MCAP0\r\n", "not a session of contid")],
)
def test_files_that_are_no_session_are_refused(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "s.mcap"
    path.write_bytes(content)
    for command in (("session", "info"), ("session", "repair"), ("replay",)):
        with pytest.raises(ContidError, match=message):
            _run(*command, path)


def test_a_pipe_is_refused_at_once(tmp_path: Path) -> None:
    path = tmp_path / "pipe"
    os.mkfifo(path)
    with pytest.raises(ContidError, match="not a regular file"):
        _run("session", "info", path)


def test_a_refused_robot_file_is_located_in_the_session(recorded: Path, tmp_path: Path) -> None:
    path, corrected = tmp_path / "old.mcap", tmp_path / "corrected.yaml"
    rewritten(recorded, path, lambda text: text.replace("rack_spacing_mm", "rack_gap_mm"))
    with pytest.raises(
        ContidError, match=r"old\.mcap: its robot file is refused(.|\n)*:\d+:\d+: unknown key"
    ):
        _run("replay", path)
    _run("session", "export", path, "--yaml", corrected)
    corrected.write_text(corrected.read_text().replace("rack_gap_mm", "rack_spacing_mm"))
    assert "bit for bit" in _run("replay", path, "--robot", corrected)


@pytest.mark.parametrize("rate", ["0", "-1", "1000.5"])
def test_a_rate_has_the_limits_of_the_robot_file(rate: str) -> None:
    with pytest.raises(ContidError, match=r"--rate: .*; allowed: above 0, at most 1000, as rate_hz"):
        _run("run", "hand", "--virtual", "--rate", rate)


def test_a_tolerance_is_a_number_and_for_comparing(recorded: Path) -> None:
    assert "'nan' is not a finite number" in _run("replay", recorded, "--tolerance", "nan", code=2)
    assert "--hardware sends" in _run("replay", recorded, "--tolerance", "1", "--hardware", code=2)


def test_repair(growing: Path, recorded: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(growing.read_bytes()[:-5000])
    assert "cut off" in _run("session", "info", cut)
    assert "exported as far as it goes" in _run("session", "export", cut, "--csv", tmp_path / "cut.csv")
    output = _run("session", "repair", cut)
    assert "clean, repaired" in output
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
    output = _run("replay", recorded, "--robot", changed, code=1)
    assert "robot file: robots.f0.geometry.rack_spacing_mm: 13 -> 13.000001" in output
    assert "first divergence: tick " in output
    assert "last equal state: tick " in output
    found = json.loads(_run("replay", recorded, "--robot", changed, "--json", code=1))
    assert found["same"] is False
    assert found["divergence"]["where"].startswith("f0.")
    assert found["divergence"]["last_equal"]["tick"] == found["divergence"]["tick"] - 1
    assert "within the tolerance" in _run("replay", recorded, "--robot", changed, "--tolerance", "1e-4")


def test_a_run_with_shaped_commands_replays(tmp_path: Path) -> None:
    robot, rows, path = tmp_path / "r.yaml", tmp_path / "t.csv", tmp_path / "s.mcap"
    text = fingers(1).replace("rates: {", "rates: {shape: {frequency_hz: 3.0, damping_ratio: 0.1}, ")
    assert "shape" in text
    robot.write_text(text)
    rows.write_text(circle_csv(1, period_s=1.0))
    assert "shape: zvd at 3 Hz; motions end 0.33 s later" in _run("check", robot)
    _run("run", robot, "--virtual", "--trajectory", rows, "--record", path)
    assert json.loads(_run("replay", path, "--json"))["same"] is True
    assert "no rule of motion was broken" in _run("session", "check", path)


@pytest.mark.realtime
def test_recorded_commands_are_sent_to_buses(tmp_path: Path) -> None:
    """The buses are simulated in real time; the code is that of real ones."""
    robot, rows, path = tmp_path / "r.yaml", tmp_path / "t.csv", tmp_path / "s.mcap"
    journal = tmp_path / "journal.jsonl"
    robot.write_text(fingers(2, options=f"journal_file: {journal}"))
    rows.write_text(circle_csv(2, period_s=0.5))
    _run("run", robot, "--virtual", "--trajectory", rows, "--record", path)
    journal.unlink()
    done = contid("replay", str(path), "--hardware", "--json")
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert {name: robot["fault"] for name, robot in report["robots"].items()} == {"f0": 0, "f1": 0}
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
def test_hardware_of_another_robot_is_refused(
    recorded: Path, tmp_path: Path, old: str, new: str, named: str
) -> None:
    other = tmp_path / "other.yaml"
    journal = tmp_path / "journal.jsonl"
    other.write_text(fingers(2, options=f"journal_file: {journal}").replace(old, new, 1))
    arguments = ["replay", str(recorded), "--hardware", "--robot", str(other)]
    with pytest.raises(ContidError, match="not the recorded robot") as refused:
        CliRunner().invoke(cli, arguments, catch_exceptions=False)
    assert named in str(refused.value)
    assert not journal.exists()


def test_geometry_may_differ_for_hardware(recorded: Path) -> None:
    from contid.robot_file.load import parse_robot_file
    from contid_sessions.replay.differences import refuse_another_robot

    session = Session(recorded)
    text = session.metadata["robot_file"]["text"]
    moved = parse_robot_file(text.replace("tip_length_mm: 22", "tip_length_mm: 21"), "moved.yaml")
    refuse_another_robot(session.robot_file(), moved)
