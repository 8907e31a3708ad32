"""Recordings of a folder: what the list has of each is what reading all of it has."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from contid import Session, Sim
from contid.errors import SessionError
from contid_sessions.info import summarize
from contid_sessions.list_command import command
from contid_sessions.listing import ListedRecording, listed, recordings_in


def recorded(path: Path, ticks: int) -> Path:
    with Sim("finger", record=path) as sim:
        sim.step({"left_mm": 50.0, "right_mm": 55.0}, ticks=ticks)
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    found = tmp_path_factory.mktemp("recordings")
    recorded(found / "first.mcap", 40)
    whole = recorded(found / "second.mcap", 80)
    (found / "cut.mcap").write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    (found / "other.mcap").write_bytes(b"nothing")
    (found / "notes.txt").write_text("no recording")
    return found


def test_a_whole_recording_is_listed_as_reading_it_shows(folder: Path) -> None:
    for name in ("first.mcap", "second.mcap"):
        found, read = listed(folder / name), summarize(Session(folder / name))
        assert found.duration_s == pytest.approx(read.duration_s, abs=1e-6)
        assert (found.began, found.bytes, found.robots) == (read.began, read.bytes, tuple(read.robots))
        assert (found.state, found.robot_file) == ("whole", "finger")


def test_what_is_not_whole_has_the_reason(folder: Path) -> None:
    assert "repair" in listed(folder / "cut.mcap").state or "cut off" in listed(folder / "cut.mcap").state
    assert listed(folder / "other.mcap").state == "not an MCAP file"


def test_the_command_lists_the_newest_first(folder: Path) -> None:
    done = CliRunner().invoke(command, [str(folder)])
    assert done.exit_code == 0
    assert len(done.output.splitlines()) == 4
    assert "finger: finger" in done.output
    rows = json.loads(CliRunner().invoke(command, [str(folder), "--json"]).output)
    assert [each["began"] for each in rows] == sorted((each["began"] for each in rows), reverse=True)


def test_an_empty_folder_and_none(tmp_path: Path) -> None:
    assert "no recording" in CliRunner().invoke(command, [str(tmp_path)]).output
    with pytest.raises(SessionError, match="cannot list it: No such file"):
        recordings_in(tmp_path / "absent")


def test_a_file_that_vanishes_meanwhile_is_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("first.mcap", "second.mcap"):
        (tmp_path / name).write_bytes(b"nothing")

    def listed_after(path: Path) -> ListedRecording:
        (tmp_path / "second.mcap").unlink(missing_ok=True)
        return listed(path)

    monkeypatch.setattr("contid_sessions.listing.listed", listed_after)
    assert [each.file for each in recordings_in(tmp_path)] == [str(tmp_path / "first.mcap")]
