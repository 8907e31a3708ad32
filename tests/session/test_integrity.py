"""Flipped bits are never read as measurements, and a power cut loses at most a second."""

from __future__ import annotations

import json
import os
import random
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import NonSeekingReader, SeekingReader

from contid.control.engine.cycle import OnEnd
from contid.control.engine.events.run import LogWritten
from contid.control.engine.wiring import record_layout
from contid.control.process import ring
from contid.control.process.pipe import RunSetup
from contid.control.process.ring_writer import RingWriter
from contid.errors import ContidError, SessionError
from contid.session.format.entries import DAMAGED
from contid.session.format.header import RecorderJob
from contid.session.format.metadata import describe
from contid.session.mcap_recorder import SYNC_PERIOD_S, McapRecorder
from contid.session.read import Session
from contid_sessions.compact import repair
from tests.support.fingers import load

TIMES = int(os.environ.get("CONTID_CAMPAIGN", "1"))
RATE_HZ = 200.0


def _contents(path: Path) -> tuple[str, str]:
    """Everything that a user reads of a session, as text: its head, and its ticks and events."""
    session = Session(path)
    entries = [(entry.time_ns, entry.values, entry.event) for entry in session.entries()]
    cut = "" if session.end.clean else session.end.cut
    return repr((session.metadata, session.layout)), repr((entries, cut == DAMAGED, session.end.clean))


@pytest.fixture(scope="module")
def unfinished(tmp_path_factory: pytest.TempPathFactory, growing: Path) -> Path:
    """What is left after a kill of the recorder: no end, the last tick not whole."""
    path = tmp_path_factory.mktemp("unfinished") / "s.mcap"
    path.write_bytes(growing.read_bytes()[:-4000])
    return path


@pytest.mark.slow
@pytest.mark.parametrize("which", ["recorded", "growing", "unfinished"])
def test_no_flipped_bit_is_silent(which: str, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    """A session with a wrong bit is refused, is named damaged, or reads the same."""
    source: Path = request.getfixturevalue(which)
    data, whole = source.read_bytes(), _contents(source)
    moments, flipped = random.Random(which), tmp_path / "flipped.mcap"
    # Anywhere, and in the heads of records, which are rare and decide what is read at all.
    places = [moments.randrange(8 * len(data)) for _ in range(5 if TIMES == 1 else 8 * TIMES)]
    places += [
        8 * at + moments.randrange(8 * 9) for at in moments.sample(_records(data), 4 + 11 * (TIMES > 1))
    ]
    for place in places:
        wrong = bytearray(data)
        wrong[place // 8] ^= 1 << place % 8
        flipped.write_bytes(wrong)
        try:
            found = _contents(flipped)
        except SessionError:
            continue
        session = Session(flipped)
        list(session.entries())
        named = session.end.cut == DAMAGED or session.end.clean != (which != "unfinished")
        assert named or found == whole, f"bit {place} of {which} is silent"
        if session.end.cut == DAMAGED:
            with pytest.raises(ContidError, match="give --output"):
                repair(flipped, None)


def _records(data: bytes) -> list[int]:
    """Places of the records of a file."""
    at, found = 8, []
    while at + 9 <= len(data) - 8:
        found.append(at)
        at += 9 + int.from_bytes(data[at + 1 : at + 9], "little")
    return found[:-1]


def test_other_readers_confirm_the_checksums(recorded: Path, growing: Path, tmp_path: Path) -> None:
    """The stock library compares the checksums of the chunks; one wrong digit is an error there too."""
    for path, reader in ((recorded, SeekingReader), (growing, NonSeekingReader)):
        with path.open("rb") as file:
            assert list(reader(file, validate_crcs=True).iter_messages())
    data = bytearray(growing.read_bytes())
    data[data.index(b'"tick":50,') + 7] ^= 1
    wrong = tmp_path / "wrong.mcap"
    wrong.write_bytes(data)
    with wrong.open("rb") as file, pytest.raises(Exception, match=r"(?i)crc"):
        list(NonSeekingReader(file, validate_crcs=True).iter_messages())


@pytest.fixture
def shared() -> Iterator[Path]:
    path = ring.create(record_layout(load(2), RATE_HZ))
    yield path
    path.unlink(missing_ok=True)


def _recorder(path: Path, shared: Path) -> McapRecorder:
    setup = RunSetup(load(2), RATE_HZ, shared, None, OnEnd.HOLD, attended=True)
    return McapRecorder(RecorderJob(path, shared, os.getpid(), describe(setup, {}, virtual=False)))


def _tick(writer: RingWriter, tick: int, deadline_s: float) -> None:
    size = writer.layout.packer().size // 8
    writer.write([tick, 0, deadline_s, *([0] * (size - 3))])


@pytest.mark.realtime
def test_a_power_cut_loses_at_most_a_second(
    tmp_path: Path, shared: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Images of the disk at random moments: what was synchronised, and any part of what was not."""
    path = tmp_path / "s.mcap"
    synced: list[tuple[float, int]] = []
    synchronise = os.fdatasync

    def fdatasync(descriptor: int) -> None:
        size = os.fstat(descriptor).st_size  # what is written during the call may be lost
        time.sleep(0.05)  # a slow disk
        synchronise(descriptor)
        synced.append((time.monotonic(), size))

    monkeypatch.setattr("contid.session.write.os.fdatasync", fdatasync)
    writer, recorder = RingWriter(shared), _recorder(path, shared)
    recording = threading.Thread(target=recorder.run)
    recording.start()
    began_s = time.monotonic()
    published: list[float] = []
    while (now_s := time.monotonic()) < began_s + 4 * SYNC_PERIOD_S:
        _tick(writer, len(published), now_s)
        published.append(now_s)
        time.sleep(1.0 / RATE_HZ)
    writer.finish()
    recording.join()
    recorder.close()
    writer.close()
    data, moments = path.read_bytes(), random.Random(1)
    assert len(synced) >= 3
    for number in range(20 * TIMES):
        cut_s = moments.uniform(synced[0][0], published[-1])
        durable = max(size for at_s, size in synced if at_s <= cut_s)
        image = bytearray(data[: moments.randint(durable, min(durable + 1_000_000, len(data)))])
        for page in range(durable // 4096 + 1, len(image) // 4096):  # blocks that were not written
            if moments.random() < 0.5:
                image[4096 * page : 4096 * (page + 1)] = bytes(4096)
        crashed = tmp_path / "crashed.mcap"
        crashed.write_bytes(image)
        session = Session(crashed)
        kept = sum(1 for _ in session.ticks())
        assert published[max(kept - 1, 0)] > cut_s - 1.0, f"image {number}"
        assert not session.end.clean


def test_an_event_is_dated_by_its_tick_however_late_it_is_recorded(tmp_path: Path, shared: Path) -> None:
    """The recorder stood still for 800 ticks; before, every event had the time at which it went on."""
    path = tmp_path / "s.mcap"
    writer, recorder = RingWriter(shared), _recorder(path, shared)
    for tick in range(800):
        if tick % 100 == 50:
            writer.event(LogWritten(level="info", logger="test", process="control", message=str(tick)))
        _tick(writer, tick, tick / RATE_HZ)
    writer.finish()
    recorder.run()
    recorder.close()
    writer.close()
    order: list[tuple[str, Any]] = []
    with path.open("rb") as file:
        for _, channel, message in NonSeekingReader(file).iter_messages(["tick", "event"]):
            order.append((channel.topic, json.loads(message.data)))
    assert len(order) == 808
    for index, (topic, fields) in enumerate(order):
        if topic == "event":
            # Between the record of the tick before it and that of its tick.
            assert order[index + 1][1]["tick"] == int(fields["message"])
