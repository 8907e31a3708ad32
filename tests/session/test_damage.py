"""Sessions with false sizes or contents that no recorder writes: bounded memory and a clear error."""

from __future__ import annotations

import io
import json
import re
import struct
import tracemalloc
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest

from contid.errors import ContidError
from contid.session.format import mcap_records as mcap
from contid.session.format import record_stream
from contid.session.format.channels import CHANNELS, EVENT
from contid.session.format.entries import DAMAGED
from contid.session.format.metadata import decode_trajectory, encode_trajectory, trajectory_metadata
from contid.session.format.record_stream import RecordStream
from contid.session.read import Session
from contid.trajectory.rows import MAX_ROWS
from contid_sessions.compact import compact, repair
from contid_sessions.info import summarize
from contid_sessions.replay.replay import replay
from tests.support.fingers import circle, load

ZEROS = 64 << 20
#: Reads are of one megabyte; the libraries have windows of a few.
BOUND = 24 << 20


@contextmanager
def bounded() -> Iterator[None]:
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < BOUND
    finally:
        tracemalloc.stop()


def zstd(data: bytes) -> bytes:
    import zstandard

    return zstandard.ZstdCompressor().compress(data)


def lz4(data: bytes) -> bytes:
    import lz4.frame

    packed: bytes = lz4.frame.compress(data)
    return packed


def session_with(chunk: bytes, cut: bool = False) -> io.BytesIO:
    data = mcap.MAGIC + mcap.RECORD.pack(mcap.CHUNK, len(chunk) + cut) + chunk
    return io.BytesIO(data)


def chunk(compression: bytes, packed: bytes, claims: int, crc: int = 0) -> bytes:
    head = struct.pack("<QQQI", 0, 0, claims, crc) + struct.pack("<I", len(compression)) + compression
    return head + struct.pack("<Q", len(packed)) + packed


@pytest.mark.parametrize("cut", [False, True])
@pytest.mark.parametrize(("name", "pack"), [(b"zstd", zstd), (b"lz4", lz4)])
@pytest.mark.parametrize("claims", [1000, 1 << 40])
def test_a_chunk_larger_than_its_declared_size_is_damage(
    name: bytes, pack: Callable[[bytes], bytes], claims: int, cut: bool
) -> None:
    whole = chunk(name, pack(bytes(ZEROS)), claims)
    with bounded():
        stream = RecordStream(session_with(whole, cut))
        assert list(stream) == []
        assert not stream.clean


def test_the_size_limit_holds_for_every_declared_size(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(record_stream, "MAX_CHUNK_BYTES", 1 << 20)
    whole = chunk(b"zstd", zstd(bytes(ZEROS)), 1 << 20)
    for cut in (False, True):
        with bounded():
            assert list(RecordStream(session_with(whole, cut))) == []


@pytest.mark.parametrize(("name", "pack"), [(b"zstd", zstd), (b"lz4", lz4)])
def test_many_small_chunks_do_not_expand_without_bound(name: bytes, pack: Callable[[bytes], bytes]) -> None:
    """A third of a megabyte of chunks, each within its limit: 3 GB and a hundred million records."""
    inside = mcap.message(1, 0, 0, b"") * (1 << 16)
    bomb = chunk(name, pack(inside), len(inside), zlib.crc32(inside))
    record = mcap.RECORD.pack(mcap.CHUNK, len(bomb)) + bomb
    times = 300_000 // len(record)
    stream = RecordStream(io.BytesIO(mcap.MAGIC + record * times))
    read = sum(len(body) + mcap.RECORD.size for _, body in stream)
    assert 0 < read <= record_stream.FREE_BYTES + record_stream.MAX_EXPANSION * len(record) * times
    if len(inside) > record_stream.MAX_EXPANSION * len(record):  # lz4 packs no better than 255-fold
        assert read < times * len(inside)
        where = len(mcap.MAGIC) + read // len(inside) * len(record)
        assert stream.damage.startswith(f"at byte {where}: its chunks expand more than")
    else:
        assert read == times * len(inside)


@pytest.mark.parametrize(("name", "pack"), [(b"zstd", zstd), (b"lz4", lz4), (b"", bytes)])
def test_chunks_of_every_kind_are_read(name: bytes, pack: Callable[[bytes], bytes]) -> None:
    inside = b"".join(mcap.message(1, n, n, bytes(1 << 19)) for n in range(5))
    stream = RecordStream(session_with(chunk(name, pack(inside), len(inside), zlib.crc32(inside))))
    assert [opcode for opcode, _ in stream] == [mcap.MESSAGE] * 5


def test_a_length_beyond_the_file_allocates_nothing() -> None:
    data = mcap.MAGIC + mcap.RECORD.pack(mcap.MESSAGE, (1 << 32) - 1) + bytes(1000)
    with bounded():
        assert list(RecordStream(io.BytesIO(data))) == []


def _with(plain: Path, folder: Path, body: bytes, before: int = mcap.DATA_END) -> Path:
    """The session with one more event, of damaged content, before the first record of a kind."""
    path = folder / "more.mcap"
    data = plain.read_bytes()
    at = len(mcap.MAGIC)
    while (head := mcap.RECORD.unpack_from(data, at))[0] != before:
        at += mcap.RECORD.size + head[1]
    path.write_bytes(data[:at] + mcap.message(CHANNELS.index(EVENT) + 1, 1, 1, body) + data[at:])
    return path


@pytest.mark.parametrize(
    "body",
    [
        b"[" * 100_000,
        b"[1]",
        b'{"tick": 1}',
        b'{"event": 1}',
        b'{"event": "end", "tick": "one"}',
        b'{"event": "end", "tick": 1e999}',
        json.dumps({"event": "end", "tick": 10**400}).encode(),
    ],
)
def test_an_invalid_event_ends_the_session(plain: Path, tmp_path: Path, body: bytes) -> None:
    whole = sum(1 for _ in Session(plain).entries())
    session = Session(_with(plain, tmp_path, body))
    assert sum(1 for _ in session.entries()) == whole
    assert session.end.cut == DAMAGED


@pytest.mark.parametrize(
    "event",
    [
        {"event": "order"},
        {"event": "order", "tick": 3},
        {"event": "order", "tick": 3, "order": "goto"},
        {"event": "order", "tick": 3, "order": "rows", "targets": 5},
        {"event": "order", "tick": 3, "order": "hold", "robots": 5},
        {"event": "order", "tick": 3, "order": "measured", "robot": "f0", "tip_m": "a"},
        {"event": "answer", "tick": 3, "bus": "bus0"},
        {"event": "answer", "tick": 3, "bus": "bus0", "lost": 5, "done": 7, "refused": 1},
        {"event": "stall", "tick": 2},
        {"event": "device", "tick": 3, "axis": [], "fault": 3},
    ],
)
def test_an_event_without_its_fields_ends_the_replay(
    plain: Path, tmp_path: Path, event: dict[str, object]
) -> None:
    session = Session(_with(plain, tmp_path, json.dumps(event).encode(), mcap.MESSAGE))
    result = replay(session, load(2))
    tick = event.get("tick", 0)
    assert result.ticks == tick
    assert result.stopped.startswith(f"tick {tick}: its event '{event['event']}' is damaged")


@pytest.mark.parametrize("missed", [{}, {"missed_ticks": "x"}])
def test_an_overrun_without_a_number_is_summarized(
    plain: Path, tmp_path: Path, missed: dict[str, str]
) -> None:
    path = _with(plain, tmp_path, json.dumps({"event": "overrun", **missed}).encode())
    assert summarize(Session(path)).events["overrun"] == 1


@pytest.mark.parametrize("deadline", ["NaN", "null", "1e99"])
def test_a_tick_without_a_time_ends_the_session(plain: Path, tmp_path: Path, deadline: str) -> None:
    """Found by the fuzzer: the summary ended with a ValueError."""
    data = plain.read_bytes()
    found = re.compile(rb'"tick":50,.*?"deadline_s":([^,}]+)').search(data)
    assert found
    path = tmp_path / "s.mcap"
    path.write_bytes(data[: found.start(1)] + deadline.encode().ljust(len(found[1])) + data[found.end(1) :])
    state = summarize(Session(path)).state
    assert state.startswith("damaged inside after 50 ticks (a record without valid content: tick 50")


def test_damage_inside_is_repaired_in_a_copy_only(
    growing: Path, plain: Path, recorded: Path, tmp_path: Path
) -> None:
    """The ticks behind the damage stay in the original."""
    path, copy = tmp_path / "s.mcap", tmp_path / "copy.mcap"
    for source in (growing, plain, recorded):
        data = bytearray(source.read_bytes())
        at = data.index(b'"tick":50,') if source is not recorded else len(data) // 2
        data[at] ^= 1
        path.write_bytes(data)
        ticks = sum(1 for _ in Session(path).ticks())
        assert ticks == (50 if source is not recorded else 0)
        state = summarize(Session(path)).state
        where = "a record without valid content" if source is plain else "at byte "
        assert state.startswith(f"damaged inside after {ticks} ticks ({where}")
        assert state.endswith("); what follows is not read")
        with pytest.raises(ContidError, match="give --output"):
            repair(path, None)
        assert path.read_bytes() == data
        assert "clean, repaired" in repair(path, copy)
        assert sum(1 for _ in Session(copy).ticks()) == ticks
        copy.unlink()


def test_a_repair_keeps_the_events_between_the_last_whole_tick_and_the_damage(
    plain: Path, tmp_path: Path
) -> None:
    """The reports of the robots and the end of a run follow its last tick."""
    ended = json.dumps({"event": "end", "tick": 1}).encode()
    path = _with(_with(plain, tmp_path, ended), tmp_path, b"[1]")
    before = summarize(Session(path))
    assert before.state.startswith("damaged inside")
    assert "clean, repaired" in repair(path, tmp_path / "copy.mcap")
    after = summarize(Session(tmp_path / "copy.mcap"))
    assert (after.ticks, after.events) == (before.ticks, before.events)


def test_compaction_does_not_drop_what_follows_damage(growing: Path, tmp_path: Path) -> None:
    path = tmp_path / "s.mcap"
    data = bytearray(growing.read_bytes())
    data[data.index(b'"tick":50,')] ^= 1
    path.write_bytes(data)
    with pytest.raises(ContidError, match=r"s\.mcap: damaged inside \(at byte .*checksum of a chunk"):
        compact(path)
    assert path.read_bytes() == data


def test_an_unknown_mode_is_printed_as_a_number(plain: Path, tmp_path: Path) -> None:
    path = tmp_path / "s.mcap"
    path.write_bytes(plain.read_bytes().replace(b'"mode":0,', b'"mode":9,'))
    assert [robot["mode"] for robot in summarize(Session(path)).robots.values()] == ["9", "9"]
    assert replay(Session(path), load(2)).divergence is not None


def _attachment(array: object, size: int | None = None) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        plain = io.BytesIO()
        np.save(plain, np.asarray(array))
        body = plain.getvalue()
        if size is not None:  # a head that declares that many rows
            head = f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({size}, 3), }}".encode()
            body = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head) + 1) + head + b"\n"
        archive.writestr("rows.npy", body)
    return out.getvalue()


@pytest.mark.parametrize(
    "data",
    [
        _attachment(np.zeros((4, 2))),
        _attachment(np.zeros(3)),
        _attachment(np.zeros((0, 3))),
        _attachment(np.zeros((4, 3), dtype=np.float32)),
        _attachment(0, size=1 << 50),
        _attachment(np.zeros((3 * MAX_ROWS, 3), dtype=np.uint8)),
        b"PK\x03\x04" + bytes(100),
        b"",
    ],
)
def test_an_attachment_that_is_no_trajectory_is_refused(data: bytes) -> None:
    loaded = load(1)
    about = trajectory_metadata(circle(loaded))
    columns = json.loads(about["columns"])
    assert len(columns) == 3
    with pytest.raises(ContidError, match="damaged"):
        decode_trajectory(data, about, loaded)


def test_a_decompression_bomb_allocates_nothing() -> None:
    loaded = load(1)
    about = trajectory_metadata(circle(loaded))
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("rows.npy", "w") as file:
        for _ in range(3):
            file.write(bytes(ZEROS // 2))
    with bounded(), pytest.raises(ContidError, match="declares"):
        decode_trajectory(out.getvalue(), about, loaded)


def test_every_flipped_bit_of_an_attachment_is_detected(growing: Path) -> None:
    loaded = load(1)
    trajectory = circle(loaded)
    data, about = encode_trajectory(trajectory), trajectory_metadata(trajectory)
    assert decode_trajectory(data, about, loaded).rows.tobytes() == trajectory.rows.tobytes()
    for at in range(0, len(data), max(1, len(data) // 300)):
        flipped = bytearray(data)
        flipped[at] ^= 1 << at % 8
        # Some bits do not change the rows; the checksum detects the others.
        with suppress(ContidError):
            assert (
                decode_trajectory(bytes(flipped), about, loaded).rows.tobytes() == trajectory.rows.tobytes()
            )
