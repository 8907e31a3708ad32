"""Recordings that are moved while they are written or compacted: what has their name then is left alone."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from contid.control.engine.cycle import OnEnd
from contid.control.process.pipe import RunSetup
from contid.errors import ContidError, RecordingStoppedError, SessionError
from contid.session.read import Session
from contid.session.recording_observer import RecordingObserver
from contid.session.write import MOVED
from contid_sessions.compact import compact
from contid_sessions.indexed_writer import IndexedWriter
from contid_sessions.info import summarize
from tests.support.fingers import circle, load, run_virtual

OTHER = b"the recording of another run"


def test_a_recording_that_was_moved_does_not_replace_the_one_with_its_name_now(tmp_path: Path) -> None:
    path, moved, loaded = tmp_path / "a.mcap", tmp_path / "b.mcap", load(1)
    trajectory = circle(loaded, period_s=0.2)
    recording = RecordingObserver(path, {"mock": "False", "input": "test"}, host="test")
    sink = recording.follow(RunSetup(loaded, 200.0, Path(), trajectory, OnEnd.STOP, attended=False))
    run_virtual(loaded, 200.0, trajectory, sinks=[sink])
    path.rename(moved)
    path.write_bytes(OTHER)
    with pytest.raises(ContidError, match=MOVED):
        recording.detach()
    assert path.read_bytes() == OTHER
    found = summarize(Session(moved))
    assert found.ticks > 0
    assert found.state.startswith("clean")


def test_a_recording_that_was_deleted_is_lost_and_not_complete(tmp_path: Path) -> None:
    path, loaded = tmp_path / "a.mcap", load(1)
    trajectory = circle(loaded, period_s=0.2)
    recording = RecordingObserver(path, {"mock": "False", "input": "test"}, host="test")
    sink = recording.follow(RunSetup(loaded, 200.0, Path(), trajectory, OnEnd.STOP, attended=False))
    run_virtual(loaded, 200.0, trajectory, sinks=[sink])
    path.unlink()
    path.write_bytes(OTHER)
    with pytest.raises(RecordingStoppedError, match="the file was deleted"):
        recording.detach()
    assert path.read_bytes() == OTHER


def test_a_file_that_comes_while_a_recording_is_compacted_is_not_replaced(
    growing: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, moved = tmp_path / "a.mcap", tmp_path / "b.mcap"
    shutil.copy(growing, path)
    whole = path.read_bytes()
    finish = IndexedWriter.finish

    def replaced_meanwhile(writer: IndexedWriter) -> None:
        path.rename(moved)
        path.write_bytes(OTHER)
        finish(writer)

    monkeypatch.setattr(IndexedWriter, "finish", replaced_meanwhile)
    with pytest.raises(SessionError, match=MOVED):
        compact(path)
    assert path.read_bytes() == OTHER
    assert moved.read_bytes() == whole
