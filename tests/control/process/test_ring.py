"""Records and events round-trip through the ring, and readers count what they missed."""

from __future__ import annotations

import errno
import math
import os
import random
import resource
import stat
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from contid.control.engine.events.buses import BusAnswered, EventTooLong
from contid.control.engine.events.robots import ModeChanged, OrderGiven, OrderRefused
from contid.control.engine.tick_layout import AXIS, HEAD, ROBOT, RecordLayout, RobotLayout
from contid.control.process import ring
from contid.control.process.ring_reader import RingReader
from contid.control.process.ring_writer import RingWriter
from contid.control.process.shared_files import folder
from tests.support.command import program

LAYOUT = RecordLayout(
    "hand",
    100.0,
    (RobotLayout("one", "rack_finger", "mm", ("left", "right")), RobotLayout("two", "x", "bar", ("p",))),
)
VALUES = HEAD.size + 2 * ROBOT.size + 3 * AXIS.size


def values(tick: int) -> list[float]:
    out: list[float] = [tick, 0, tick * 0.01, 1e-5, 2e-4, math.pi]
    for robot, axes in enumerate((2, 1)):
        out += [5, 0, 7, 1 << 40, robot, *(k + 0.25 for k in range(ROBOT.size - 5))]
        for axis in range(axes):
            out += [axis + 0.1 * k for k in range(AXIS.size)]
    return out


def test_costs_of_robots_are_means_and_touch_no_record(path: Path) -> None:
    writer, reader = RingWriter(path), RingReader(path)
    assert reader.costs_s == [0.0, 0.0]
    for tick in range(300):
        writer.write(values(tick))
        writer.publish_costs([2e-4 if tick % 2 else 1e-4, 3e-3])
    assert reader.costs_s == pytest.approx([1.5e-4, 3e-3], rel=0.05)
    assert [record.tick for record in reader.ticks()] == list(range(300))[-reader.slots + 1 :]
    writer.close()
    reader.close()


def test_the_record_of_a_tick_is_found_among_skipped_and_overwritten_ones(path: Path) -> None:
    writer, reader = RingWriter(path), RingReader(path)
    assert reader.record_of(0) is None
    written = [tick for tick in range(1000) if tick % 7 not in (3, 4)]
    for tick in written:
        writer.write(values(tick))
    for asked in (*range(900, 998), 999):
        found = reader.record_of(asked)
        assert found is not None
        assert found.tick == min(tick for tick in written if tick >= asked)
    oldest = reader.record_of(5)  # it was overwritten
    assert oldest is not None
    assert oldest.tick == written[-reader.slots + 1]
    assert reader.record_of(1000) is None
    reader.close()
    writer.close()


@pytest.fixture
def path() -> Iterator[Path]:
    path = ring.create(LAYOUT, seconds=0.1)
    yield path
    path.unlink()


def test_a_record_comes_back_exactly(path: Path) -> None:
    writer, reader = RingWriter(path), RingReader(path)
    assert len(values(0)) == VALUES
    writer.write(values(3))
    (record,) = reader.ticks()
    assert reader.newest() == record
    assert (record.tick, record.source_s) == (3, math.pi)
    one, two = record.robots
    assert one.limited_by == 1 << 40
    assert (one.tip_m, one.direction, one.mid_m, one.load_n) == (
        (0.25, 1.25, 2.25),
        (3.25, 4.25, 5.25),
        (6.25, 7.25, 8.25),
        (9.25, 10.25, 11.25),
    )
    assert (one.residual_m, one.tip_error_m) == (12.25, 13.25)
    assert (one.measured_tip_m, one.measured_direction) == ((14.25, 15.25, 16.25), (17.25, 18.25, 19.25))
    assert one.measured_age_s == 20.25
    assert list(two.axes[0]) == [0.1 * k for k in range(AXIS.size)]
    assert reader.layout == LAYOUT
    assert reader.ticks() == []
    writer.close()
    reader.close()


WRITER = """
import sys
from pathlib import Path
from contid.control.process.ring_writer import RingWriter
from tests.control.process.test_ring import values
writer, contents = RingWriter(Path(sys.argv[1])), values(3)
for _ in range(15_000):
    writer.write(contents)
writer.finish()
"""


@pytest.mark.process
def test_the_number_of_records_never_falls_while_another_process_writes(path: Path) -> None:
    reader = RingReader(path)
    with subprocess.Popen(program(WRITER, str(path))) as process:
        last = 0
        while not reader.finished and process.poll() is None:
            for _ in range(1000):
                written = reader.written
                assert written >= last, f"{written} after {last}"
                last = written
    assert process.returncode == 0
    assert reader.written == 15_000
    reader.close()


def test_readers_count_what_they_missed(path: Path) -> None:
    writer, late, quick = RingWriter(path), RingReader(path), RingReader(path)
    seen = 0
    for tick in range(1000):
        writer.write(values(tick))
        seen += len(quick.ticks())
    assert (seen, quick.missed_ticks) == (1000, 0)
    records = late.ticks()
    assert records[-1].tick == 999
    assert len(records) + late.missed_ticks == 1000
    assert [r.tick for r in records] == list(range(late.missed_ticks, 1000))
    for each in (writer, late, quick):
        each.close()


@pytest.mark.parametrize("at", [ring.STAMP.size, ring.STAMP.size + 8 * 40, -1])
def test_a_slot_whose_stores_arrive_late_is_read_when_it_is_whole(path: Path, at: int) -> None:
    """As on a processor that shows a reader the stamp before the contents: the test tears the slot."""
    writer, reader = RingWriter(path), RingReader(path)
    for tick in range(40):  # the second lap: what is torn has the bytes of another record
        writer.write(values(tick))
    assert len(reader.ticks()) == reader.written == 40
    start = writer._ticks_at + 40 % writer.slots * writer.size
    before = writer._map[start : start + writer.size]
    writer.write(values(40))
    place = start + at % writer.size
    whole, writer._map[place] = writer._map[place], before[at % writer.size] ^ 0x55
    assert reader.newest() is None
    assert reader.ticks() == []
    assert reader.missed_ticks == 0
    writer._map[place] = whole
    assert [record.tick for record in reader.ticks()] == [40]
    writer.close()
    reader.close()


def test_a_slot_that_stays_torn_is_counted_and_passed(path: Path) -> None:
    writer, reader = RingWriter(path), RingReader(path)
    for tick in range(3):
        writer.write(values(tick))
        writer.event(ModeChanged(robot="one", mode="RUN", tick=tick))
    for start, size in ((writer._ticks_at, writer.size), (writer._events_at, ring.EVENT_BYTES)):
        writer._map[start + size + ring.STAMP.size + 20] ^= 0xFF
    assert [record.tick for record in reader.ticks()] == [0, 2]
    assert [event.tick for event in reader.events() if isinstance(event, ModeChanged)] == [0, 2]
    assert (reader.missed_ticks, reader.missed_events) == (1, 1)
    writer.close()
    reader.close()


def test_events_are_json(path: Path) -> None:
    writer, reader = RingWriter(path), RingReader(path)
    event = ModeChanged(robot="one", mode="RUN", tick=3)
    writer.event(event)
    assert reader.events() == [event]
    assert not reader.finished
    writer.finish()
    assert reader.finished
    writer.close()
    reader.close()


def test_events_longer_than_a_slot_arrive_complete_or_marked_as_cut(path: Path) -> None:
    writer, reader = RingWriter(path), RingReader(path)
    done = [[f"robot_{number}", "READY"] for number in range(500)]
    event = BusAnswered(tick=1, bus="bus0", lost="", done=done, refused=[])
    writer.event(event)
    assert reader.events() == [event]
    writer.event(OrderRefused(robot="one", message="\N{ROBOT FACE}" * 1_000_000))
    (cut,) = reader.events()
    assert isinstance(cut, OrderRefused)
    assert (cut.robot, cut.message[:1], cut.message[-4:]) == (
        "one",
        "\N{ROBOT FACE}",
        "\N{ROBOT FACE}...",
    )
    writer.event(replace(event, done=done * 50))
    assert reader.events() == [EventTooLong(kind="answer")]
    writer.close()
    reader.close()


@pytest.mark.slow
@pytest.mark.parametrize("rounds", [pytest.param(40, marks=pytest.mark.campaign), 5])
def test_a_slow_reader_never_joins_parts_of_different_events(path: Path, rounds: int) -> None:
    writer, reader = RingWriter(path), RingReader(path)
    dice, written, read = random.Random(4), 0, []
    for _ in range(rounds):
        for _ in range(dice.randrange(1200)):
            ballast = [written] * dice.choice((1, 1, 500, 3000))
            writer.event(OrderGiven(tick=written, order={"order": "rows", "ballast": ballast}))
            written += 1
        read += reader.events()
    orders = [event for event in read if isinstance(event, OrderGiven)]
    assert orders == read
    assert all(set(event.order["ballast"]) == {event.tick} for event in orders)
    numbers = [event.tick for event in orders]
    assert numbers == sorted(set(numbers))
    assert len(numbers) < written  # some were overwritten
    assert reader.missed_events > 0
    writer.close()
    reader.close()


def test_only_the_owner_may_read_the_file(path: Path) -> None:
    assert stat.S_IMODE(path.stat().st_mode) == 0o600


def test_the_memory_is_allocated_at_creation(path: Path) -> None:
    assert path.stat().st_blocks * 512 >= path.stat().st_size


def test_lack_of_space_is_an_error_at_creation() -> None:
    before = set(folder().glob(f"contid-{os.getpid()}-*"))
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 20, hard))
    try:
        with pytest.raises(ring.RingError, match=r"no shared memory of 2\.\d MB for this run"):
            ring.create(LAYOUT, seconds=0.1)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert set(folder().glob(f"contid-{os.getpid()}-*")) == before


def test_a_reader_outlives_the_file() -> None:
    path = ring.create(LAYOUT, seconds=0.1)
    writer, reader = RingWriter(path), RingReader(path)
    path.unlink()
    writer.write(values(1))
    assert reader.ticks()[0].tick == 1
    writer.close()
    reader.close()
    with pytest.raises(ring.RingError, match="no ring to attach to"):
        RingReader(path)


def test_other_files_are_refused(tmp_path: Path) -> None:
    other = tmp_path / "other"
    other.write_bytes(b"x" * 100)
    with pytest.raises(ring.RingError, match="not a ring"):
        RingReader(other)


@pytest.mark.parametrize("head", [b"", b"\0" * 4096, ring.MAGIC + b"\0" * 4096])
def test_an_incomplete_ring_is_refused_and_its_descriptor_closed(tmp_path: Path, head: bytes) -> None:
    path = tmp_path / "half.ring"
    path.write_bytes(head)
    before = len(list(Path("/proc/self/fd").iterdir()))
    with pytest.raises((ring.RingError, ValueError)):
        RingReader(path)
    assert len(list(Path("/proc/self/fd").iterdir())) == before


@pytest.mark.parametrize(("number", "remedy"), [(errno.EROFS, "mount a tmpfs"), (errno.ENOSPC, "--shm-size")])
def test_shared_memory_that_cannot_be_used_has_its_remedy(
    number: int, remedy: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*arguments: object) -> int:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, "open", refuse)
    with pytest.raises(ring.RingError, match=remedy):
        ring.create(LAYOUT, seconds=0.1)
