"""Session files: stock readers read them, every truncation is readable and repairable, exports are exact."""

from __future__ import annotations

import csv
import itertools
import json
import os
import subprocess
import sys
from collections import Counter
from dataclasses import asdict
from pathlib import Path

import pytest
from mcap.reader import make_reader

from contid.control.engine.cycle import OnEnd
from contid.control.process.pipe import RunSetup
from contid.errors import ContidError, SessionError
from contid.session.format.channels import CHANNELS, EVENT, MEASURED, TICK_CHANNELS
from contid.session.format.metadata import describe
from contid.session.read import Session
from contid.session.write import SessionWriter
from contid_sessions.compact import compact, repair
from contid_sessions.csv_files import export_channels, export_joined
from contid_sessions.info import summarize
from contid_sessions.replay.replay import replay
from tests.session.rewrite import rewritten
from tests.support.fingers import load

pytestmark = pytest.mark.process

#: Truncations tried per file; CI runs the short form, ``CONTID_CAMPAIGN=1`` two hundred times as many.
CUTS = 4000 if os.environ.get("CONTID_CAMPAIGN") else 20


def _values(path: Path) -> list[list[float]]:
    return [entry.values for entry in Session(path).entries() if entry.values is not None]


def _events(path: Path) -> list[object]:
    return list(Session(path).events())


def test_compaction_keeps_everything_and_is_smaller(recorded: Path, growing: Path) -> None:
    assert repr(_values(recorded)) == repr(_values(growing))
    assert _events(recorded) == _events(growing)
    assert recorded.stat().st_size < growing.stat().st_size / 3


@pytest.mark.parametrize("which", ["recorded", "growing"])
def test_the_stock_reader_reads_it(which: str, request: pytest.FixtureRequest) -> None:
    """Required by Foxglove: channels, schemas, JSON, ordered times, an index when compacted."""
    from mcap.reader import NonSeekingReader, SeekingReader

    path: Path = request.getfixturevalue(which)
    ticks = len(_values(path))
    with path.open("rb") as file:
        reader = SeekingReader(file, validate_crcs=True) if which == "recorded" else NonSeekingReader(file)
        messages = list(reader.iter_messages())
        counts = Counter(channel.topic for _, channel, _ in messages)
        channels = (*TICK_CHANNELS, MEASURED) if which == "recorded" else TICK_CHANNELS
        assert counts == {**dict.fromkeys(channels, ticks), "event": len(_events(path))}
        times = [message.log_time for _, _, message in messages]
        assert times == sorted(times)
        for schema, channel, message in messages:
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            assert json.loads(schema.data)["type"] == "object"
            assert json.loads(message.data).get("tick", 0) >= 0
    with path.open("rb") as file:
        reader = SeekingReader(file) if which == "recorded" else NonSeekingReader(file)
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}
    assert metadata["robot_file"]["text"].startswith("contid: 1")
    assert {"contid", "python", "numpy", "host", "kernel", "kernels"} <= set(metadata["contid"])
    if which == "recorded":
        with path.open("rb") as file:
            summary = SeekingReader(file).get_summary()
            assert summary is not None
            assert summary.statistics is not None
            assert summary.statistics.message_count == len(messages)
            assert {channel.topic for channel in summary.channels.values()} == {*CHANNELS, MEASURED}
            assert [each.name for each in SeekingReader(file).iter_attachments()] == ["trajectory.npz"]


@pytest.mark.process
@pytest.mark.parametrize("which", ["recorded", "growing"])
def test_truncated_anywhere_it_is_read_repaired_and_replayed(
    which: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    path: Path = request.getfixturevalue(which)
    data, whole = path.read_bytes(), _values(path)
    ends = _tick_ends(path) if which == "growing" else []
    cut = tmp_path / "cut.mcap"
    for step in range(CUTS):
        size = len(data) * step // CUTS + step % 7
        cut.write_bytes(data[:size])
        try:
            session = Session(cut)
        except SessionError:
            assert size < 28_000  # within the head, before the first tick
            continue
        got = [entry.values for entry in session.entries() if entry.values is not None]
        assert repr(got) == repr(whole[: len(got)])
        assert not session.end.clean
        assert session.end.cut
        if which == "growing":
            assert len(got) == sum(end <= size for end in ends)
        if step % 5 == 0:
            assert summarize(session).ticks == len(got)
            repaired = compact(cut, tmp_path / f"{step}.mcap", {"repaired": {"when": "now"}})
            assert repr(_values(repaired)) == repr(got)
            fixed = Session(repaired)
            assert summarize(fixed).state == "clean, repaired now"
            if step % 15 == 0:
                result = replay(fixed, fixed.robot_file())
                assert (result.divergence, result.ticks) == (None, len(got))


def _tick_ends(path: Path) -> list[int]:
    """End of the last message of every tick in a file that was not compacted."""
    from contid.session.format.mcap_records import CHUNK, CHUNK_HEAD, MAGIC, MESSAGE, RECORD

    data, at, ends = path.read_bytes(), len(MAGIC), []
    last = TICK_CHANNELS.index("sample") + 1
    while at + RECORD.size <= len(data) - len(MAGIC):
        opcode, length = RECORD.unpack_from(data, at)
        # The messages of a chunk stand behind its head, the length of its empty compression and their own.
        at += RECORD.size + (CHUNK_HEAD.size + 4 + 8 if opcode == CHUNK else length)
        if opcode == MESSAGE and data[at - length] == last:
            ends.append(at)
    return ends


def test_zeros_of_unwritten_blocks_end_the_session(growing: Path, tmp_path: Path) -> None:
    data = growing.read_bytes()
    cut = tmp_path / "zeros.mcap"
    for keep in (len(data) // 2, len(data) // 2 + 100, len(data) // 2 + 1000):
        cut.write_bytes(data[:keep] + bytes(8192))
        session = Session(cut)
        got = [entry.values for entry in session.entries() if entry.values is not None]
        assert 0 < len(got) < len(_values(growing))
        assert repr(got) == repr(_values(growing)[: len(got)])
        assert not session.end.clean


def test_other_files_are_refused(tmp_path: Path, recorded: Path) -> None:
    other = tmp_path / "other.mcap"
    other.write_text("t_s,x_mm\n0,1\n")
    with pytest.raises(SessionError, match="not an MCAP file"):
        Session(other)
    other.write_bytes(recorded.read_bytes()[:100])
    with pytest.raises(SessionError, match="cut off before its first tick"):
        Session(other)
    with pytest.raises(SessionError, match="not a regular file"):
        Session(tmp_path)
    for unreadable in (tmp_path / ("s" * 300), other / "s.mcap", tmp_path / "none.mcap"):
        with pytest.raises(SessionError, match="cannot read it"):
            Session(unreadable)


def test_a_session_being_recorded_is_not_repaired(tmp_path: Path) -> None:
    """The recorder would continue to write into the replaced, unlinked file."""
    loaded = load(2)
    path = tmp_path / "s.mcap"
    setup = RunSetup(loaded, 200.0, Path(), None, OnEnd.STOP, attended=False)
    writer = SessionWriter(path, describe(setup, {}, virtual=True))
    assert summarize(Session(path)).state == "still being recorded"
    before = path.read_bytes()
    for output in (None, tmp_path / "copy.mcap"):
        with pytest.raises(SessionError, match="nothing to repair before the run has ended"):
            repair(path, output)
    assert path.read_bytes() == before
    writer.finish()
    assert summarize(Session(path)).state == "clean"
    assert repair(path, None).endswith("0 of 0 ticks, clean")


def test_files_rewritten_by_other_programs_are_read_and_replayed(recorded: Path, tmp_path: Path) -> None:
    session = Session(rewritten(recorded, tmp_path / "other.mcap"))
    assert repr(_values(session.path)) == repr(_values(recorded))
    assert _events(session.path) == _events(recorded)
    result = replay(session, session.robot_file())
    assert (result.divergence, result.stopped) == (None, "")
    whole = Session(compact(session.path, tmp_path / "again.mcap"))
    assert summarize(whole).ticks == result.ticks
    with whole.path.open("rb") as file:
        counts = Counter(channel.topic for _, channel, _ in make_reader(file).iter_messages())
    assert counts[MEASURED] == result.ticks, "the channel that it had is kept, and not computed again"


def test_parts_removed_by_a_filter_are_named(recorded: Path, tmp_path: Path) -> None:
    with pytest.raises(SessionError, match="--include-metadata"):
        Session(rewritten(recorded, tmp_path / "bare.mcap", metadata=False))
    session = Session(rewritten(recorded, tmp_path / "rowless.mcap", attachments=False))
    with pytest.raises(SessionError, match=r"trajectory\.npz is missing.*--include-attachments"):
        replay(session, session.robot_file())


def test_chunks_do_not_overlap_in_time(
    recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`mcap info` and Foxglove treat overlaps as messages out of order."""
    from mcap.reader import SeekingReader

    monkeypatch.setattr("contid_sessions.indexed_writer.CHUNK_BYTES", 10_000)
    path = compact(recorded, tmp_path / "small.mcap")
    with path.open("rb") as file:
        summary = SeekingReader(file).get_summary()
    assert summary is not None
    times = [(each.message_start_time, each.message_end_time) for each in summary.chunk_indexes]
    assert len(times) > 10
    assert all(end < start for (_, end), (start, _) in itertools.pairwise(times))


def test_a_recording_is_never_overwritten(recorded: Path) -> None:
    before = recorded.read_bytes()
    setup = RunSetup(load(2), 200.0, Path(), None, OnEnd.STOP, attended=False)
    with pytest.raises(ContidError, match="never overwritten"):
        SessionWriter(recorded, describe(setup, {}, virtual=True))
    assert recorded.read_bytes() == before


def test_tables_have_the_units_of_robot_files(recorded: Path, tmp_path: Path) -> None:
    session = Session(recorded)
    ticks = list(session.ticks())
    paths = export_channels(session, tmp_path / "out")
    assert [path.stem for path in paths] == [*TICK_CHANNELS, MEASURED, EVENT]
    tables = {path.stem: _table(path) for path in paths}
    for row, record in zip(tables["command"], ticks, strict=True):
        command = record.robots[1].axes[0].command
        assert row["f1.left_mm"] == ("" if command != command else repr(command * 1e3))
        assert float(row["t_s"]) == record.tick / 200.0
    assert float(tables["target"][150]["f0.x_mm"]) == ticks[150].robots[0].tip_m[0] * 1e3
    assert tables["tick"][150]["f0.mode"] == str(ticks[150].robots[0].mode)
    assert {row["event"] for row in tables["event"]} >= {"state", "end", "answer"}
    export_joined(session, tmp_path / "all.csv")
    joined = _table(tmp_path / "all.csv")
    assert [row["command.f1.left_mm"] for row in joined] == [row["f1.left_mm"] for row in tables["command"]]


def _table(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_the_summary_lists_faults_and_events(recorded: Path) -> None:
    info = summarize(Session(recorded))
    assert info.state == "clean"
    assert info.compacted
    assert info.virtual
    assert (info.late, info.skipped, info.lost, info.faults) == (0, 0, 0, [])
    assert {name: robot["mode"] for name, robot in info.robots.items()} == {"f0": "OFF", "f1": "OFF"}
    assert info.duration_s == pytest.approx((info.ticks - 1) / 200.0, abs=1e-6)
    assert info.input == "test, 51 rows"
    json.dumps(asdict(info))


@pytest.mark.process
def test_the_recorder_does_not_import_numpy() -> None:
    """It would cost 14 MB for the duration of a run."""
    message = "import contid.session.mcap_recorder, sys; print('numpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", message], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
