"""Sessions merged on one clock, as the stock reader of MCAP finds them."""

from __future__ import annotations

import itertools
import json
from collections import Counter
from pathlib import Path

import pytest
from mcap.reader import SeekingReader

from contid.control.engine.cycle import OnEnd
from contid.control.engine.events.run import NoteWritten
from contid.control.process.pipe import RunSetup
from contid.session.format.metadata import describe
from contid.session.read import Session
from contid.session.write import SessionWriter
from contid_sessions.merge import merge_sessions
from tests.support.fingers import load


def noted(recorded: Path, path: Path, node: str, offset_s: float) -> Path:
    """The ticks of a session as those of a node whose clock is ahead of the conductor's."""
    loaded = load(2)
    header = describe(RunSetup(loaded, 200.0, Path(), None, OnEnd.STOP, attended=False), {}, virtual=True)
    writer = SessionWriter(path, header)
    note = NoteWritten(
        experiment="e", node=node, conductor="c", at_s=0.0, offset_s=offset_s, bound_s=1e-4, wall_s=1.7e9
    )
    writer.event(note)
    packer = header.layout.packer()
    for entry in Session(recorded).entries():
        if entry.values is not None:
            writer.tick(packer.unpack(packer.pack(*entry.values)))
    writer.finish()
    return path


def test_merged_sessions_are_on_one_clock_and_chunks_do_not_overlap(
    recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`mcap info` and Foxglove treat overlaps as messages out of order."""
    monkeypatch.setattr("contid_sessions.indexed_writer.CHUNK_BYTES", 10_000)
    ahead = {"a": 0.0, "b": -0.0012}
    paths = [noted(recorded, tmp_path / f"{node}.mcap", node, offset_s) for node, offset_s in ahead.items()]
    merged = tmp_path / "merged.mcap"
    report = merge_sessions(paths, merged)
    with merged.open("rb") as file:
        reader = SeekingReader(file, validate_crcs=True)
        summary = reader.get_summary()
        messages = [(schema, channel, message) for schema, channel, message in reader.iter_messages()]
    assert summary is not None
    assert summary.statistics is not None
    chunks = [(each.message_start_time, each.message_end_time) for each in summary.chunk_indexes]
    assert len(chunks) > 10
    assert all(end < start for (_, end), (start, _) in itertools.pairwise(chunks))
    counts = Counter(channel.topic for _, channel, _ in messages)
    assert summary.statistics.message_count == sum(counts.values()) == sum(report.messages.values())
    for node in ahead:
        ticks = [message for _, channel, message in messages if channel.topic == f"/{node}/tick"]
        assert len(ticks) == sum(1 for _ in Session(recorded).ticks())
        assert [json.loads(each.data)["tick"] for each in ticks] == [each.sequence for each in ticks]
        # 1.7e9 s at time 0 of the conductor.
        began_s = (ticks[0].log_time - 1_700_000_000 * 10**9) * 1e-9
        assert began_s == pytest.approx(ticks[0].sequence / 200.0 - ahead[node], abs=1e-6)
    assert all(schema is not None and schema.name.split("/")[0] in ahead for schema, _, _ in messages)
