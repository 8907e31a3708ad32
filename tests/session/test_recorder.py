"""The recorder's process: loses no tick, does not disturb a run, outlives the daemon, reports an overrun."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from contid.control.engine.cycle import OnEnd
from contid.control.engine.events.buses import RecorderFailed
from contid.control.engine.events.robots import OrderGiven
from contid.control.engine.wiring import record_layout
from contid.control.process import ring
from contid.control.process.pipe import RunSetup
from contid.control.process.ring_writer import RingWriter
from contid.errors import ContidError
from contid.session.format.header import RecorderJob
from contid.session.format.metadata import describe
from contid.session.mcap_recorder import McapRecorder
from contid.session.read import Session
from contid.session.recording_observer import RecordingObserver
from contid_sessions.info import summarize
from contid_sessions.replay.replay import replay
from tests.session.kills import VICTIMS, kill_one
from tests.support.command import contid
from tests.support.fingers import circle_csv, fingers, load

pytestmark = pytest.mark.process

KILLS = int(os.environ.get("CONTID_CAMPAIGN", "1"))


@pytest.fixture
def shared() -> Iterator[Path]:
    """A ring for two fingers, with room for 256 ticks."""
    path = ring.create(record_layout(load(2), 200.0), seconds=0.0)
    yield path
    path.unlink(missing_ok=True)


def _job(path: Path, shared: Path, pid: int) -> RecorderJob:
    setup = RunSetup(load(2), 200.0, shared, None, OnEnd.HOLD, attended=True)
    return RecorderJob(path, shared, pid, describe(setup, {"mock": "False"}, virtual=False))


def _values(writer: RingWriter, tick: int) -> list[float]:
    size = writer.layout.packer().size // 8
    return [tick, 0, tick / 200.0, *([0] * (size - 3))]


@pytest.mark.realtime
@pytest.mark.parametrize("buses", [pytest.param(1, marks=pytest.mark.campaign), 3])
def test_a_run_in_real_time_is_recorded_completely_and_replays(buses: int, tmp_path: Path) -> None:
    """With several buses each has a worker thread; late and refused answers are events."""
    robot, rows, path = tmp_path / "r.yaml", tmp_path / "t.csv", tmp_path / "s.mcap"
    robot.write_text(fingers(3, buses=buses))
    rows.write_text(circle_csv(3, period_s=0.5))
    done = contid("run", str(robot), "--trajectory", str(rows), "--record", str(path), "--json")
    assert done.returncode == 0, done.stderr
    info = summarize(Session(path))
    assert (info.state, info.compacted, info.lost) == ("clean", True, 0)
    assert f'"ticks": {info.ticks},' in done.stdout
    replayed = contid("replay", str(path))
    assert replayed.returncode == 0, replayed.stdout
    assert "every command is the same, bit for bit" in replayed.stdout


@pytest.mark.realtime
def test_a_row_for_many_robots_is_recorded_completely_and_replays(tmp_path: Path) -> None:
    """Its event takes several slots of the ring."""
    robot, path = tmp_path / "r.yaml", tmp_path / "s.mcap"
    robot.write_text(fingers(24).replace("rate_hz: 200", "rate_hz: 20"))
    header = ",".join(f"f{index}.x_mm,f{index}.y_mm" for index in range(24))
    rows = "".join(",".join(["50", str(75 + row)] * 24) + "\n" for row in range(3))
    done = contid("run", str(robot), "--mock", "--record", str(path), stdin=f"{header}\n{rows}")
    assert done.returncode == 0, done.stderr
    rows_seen = [
        event.order
        for event in Session(path).events()
        if isinstance(event, OrderGiven) and event.order["order"] == "rows"
    ]
    # Rows that are read together make one order, of the newest.
    assert 1 <= len(rows_seen) <= 3
    assert {len(event["targets"]) for event in rows_seen} == {24}
    replayed = contid("replay", str(path))
    assert replayed.returncode == 0, replayed.stdout


@pytest.mark.realtime
@pytest.mark.parametrize("victim", VICTIMS)
@pytest.mark.parametrize("number", range(KILLS))
def test_a_kill_loses_at_most_the_last_tick(victim: str, number: int, tmp_path: Path) -> None:
    left = kill_one(tmp_path, victim, 0.1 + 0.37 * number % 1.0)
    if victim == "recorder":
        assert left.recorded > 0  # the number of missing ticks depends on the load of the machine
    else:
        assert left.lost == 0
        assert left.clean
    assert left.recorded == left.repaired == left.replayed


def test_an_existing_file_is_refused_before_the_robot_moves(tmp_path: Path) -> None:
    robot, rows, path = tmp_path / "r.yaml", tmp_path / "t.csv", tmp_path / "s.mcap"
    robot.write_text(fingers(1, options=f"journal_file: {tmp_path / 'journal'}"))
    rows.write_text(circle_csv(1))
    path.write_text("precious")
    for extra in ([], ["--virtual"]):
        done = contid("run", str(robot), "--trajectory", str(rows), "--record", str(path), *extra)
        assert done.returncode == 2
        assert "never overwritten" in done.stderr
        assert path.read_text() == "precious"
    assert not (tmp_path / "journal").exists() or "enable" not in (tmp_path / "journal").read_text()


def test_a_missing_folder_is_named(tmp_path: Path, shared: Path) -> None:
    recording = RecordingObserver(tmp_path / "missing" / "s.mcap", {})
    setup = RunSetup(load(2), 200.0, shared, None, OnEnd.HOLD, attended=True)
    with pytest.raises(ContidError, match=r"missing/s\.mcap: cannot record: No such file"):
        recording.attach(setup, os.getpid())


def test_ticks_lost_in_an_overrun_are_counted(tmp_path: Path, shared: Path) -> None:
    writer = RingWriter(shared)
    recorder = McapRecorder(_job(tmp_path / "s.mcap", shared, os.getpid()))
    for tick in range(1000):
        writer.write(_values(writer, tick))
    writer.finish()
    recorder.run()
    recorder.close()
    writer.close()
    session = Session(tmp_path / "s.mcap")
    info = summarize(session)
    assert info.ticks + info.lost == 1000
    assert info.lost > 700
    assert any("overrun" in line for line in info.listed)
    assert replay(session, load(2)).stopped.startswith("ticks 0 to ")


@pytest.mark.realtime
def test_it_ends_with_the_writer_of_the_ring(tmp_path: Path, shared: Path) -> None:
    writer = RingWriter(shared)
    control = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    recorder = McapRecorder(_job(tmp_path / "s.mcap", shared, control.pid))
    for tick in range(10):
        writer.write(_values(writer, tick))
    control.kill()
    recorder.run()
    control.wait()
    recorder.close()
    writer.close()
    session = Session(tmp_path / "s.mcap")
    assert summarize(session).ticks == 10
    assert RecorderFailed(message="the control process ended unexpectedly") in session.events()


@pytest.mark.realtime
def test_it_sleeps_between_ticks(tmp_path: Path, shared: Path) -> None:
    """An idle ring costs almost no processor time, which does not depend on the load of the machine."""
    control = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(0.5)"])
    recorder = McapRecorder(_job(tmp_path / "s.mcap", shared, control.pid))
    before_s, wall_s = time.process_time(), time.monotonic()
    recorder.run()
    control.wait()
    recorder.close()
    assert time.process_time() - before_s < 0.3 * (time.monotonic() - wall_s)


def test_a_full_disk_is_reported(tmp_path: Path, shared: Path) -> None:
    recorder = McapRecorder(_job(tmp_path / "s.mcap", shared, os.getpid()))
    full = os.open("/dev/full", os.O_WRONLY)
    os.dup2(full, recorder._writer._file)
    os.close(full)
    writer = RingWriter(shared)
    writer.write(_values(writer, 0))
    with pytest.raises(ContidError, match="recording stopped: No space left on device"):
        recorder.run()
    recorder.close()
    writer.close()
