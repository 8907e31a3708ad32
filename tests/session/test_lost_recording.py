"""A recording that was asked for and is lost is in ``status``, and ends a run with exit code 1."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from contid.control.engine.cycle import OnEnd
from contid.control.engine.wiring import record_layout
from contid.control.process import ring
from contid.control.process.pipe import RunSetup
from contid.control.process.ring_writer import RingWriter
from contid.session import recording_observer
from contid.session.format.header import Attached
from contid.session.recording_observer import RecordingObserver
from tests.support.daemons import fast_daemon as daemon
from tests.support.fingers import load
from tests.support.waiting import until

pytestmark = pytest.mark.process

ROWS = "t_s,x_mm,y_mm\n0,50,70\n1,52,70\n2,50,70\n"


def _recorder(daemon: int) -> int:
    """Process id of the recorder that a daemon started, 0 if there is none."""
    for child in Path(f"/proc/{daemon}/task/{daemon}/children").read_text().split():
        if b"contid.session.mcap_recorder" in Path(f"/proc/{child}/cmdline").read_bytes():
            return int(child)
    return 0


@pytest.mark.realtime
@pytest.mark.parametrize("full", [False, True])
def test_a_lost_recording_sets_the_exit_code_of_the_run(full: bool, tmp_path: Path) -> None:
    """The recorder's file may grow no further: the same path as a full disk, without a disk of its own."""
    (tmp_path / "rows.csv").write_text(ROWS)
    session = tmp_path / "a.mcap"
    command = ["run", "finger", "--mock", "--trajectory", "rows.csv", "--record", session.name]
    process = subprocess.Popen(
        [sys.executable, "-m", "contid", *command, "--socket", "a.sock"],
        cwd=tmp_path,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        until(lambda: session.exists() or process.poll() is not None, "the recording")
        until(lambda: session.stat().st_size > 0, "its first bytes")
        if full:
            size = session.stat().st_size
            resource.prlimit(_recorder(process.pid), resource.RLIMIT_FSIZE, (size, size))
        stdout, stderr = process.communicate(timeout=60)
    finally:
        process.kill()
        process.communicate()
    assert process.returncode == (1 if full else 0), stdout + stderr
    assert ("recording is incomplete (exit code 1)" in stdout) == full
    assert ("File too large" in stdout) == full


def test_a_recording_in_virtual_time_that_is_lost_is_no_wrong_use(tmp_path: Path) -> None:
    """Its file may grow to 60 kB, which its head and some ticks take."""
    (tmp_path / "rows.csv").write_text(ROWS)
    limit = f"ulimit -f 60; exec {sys.executable} -m contid"
    command = f"{limit} run finger --virtual --trajectory rows.csv --record a.mcap"
    done = subprocess.run(
        ["bash", "-c", command], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, "a.mcap: recording stopped: File too large" in done.stderr) == (1, True)


@pytest.mark.realtime
def test_a_recorder_that_failed_is_in_the_status(tmp_path: Path) -> None:
    with daemon(1, "--record", str(tmp_path / "a.mcap")) as running, running.client() as client:
        (listed,) = client.status()["recordings"]
        assert (listed["state"], listed["missed_ticks"]) == ("recording", 0)
        os.kill(_recorder(running.process.pid), signal.SIGKILL)
        until(lambda: client.status()["recordings"][0]["state"] == "failed", "the failure is listed")
        until(
            lambda: any(
                "nothing more is recorded" in each["message"] for each in client.status()["warnings"]
            ),
            "the failure is a warning",
        )


@pytest.mark.realtime
def test_ticks_that_a_slow_disk_lost_are_reported_while_it_runs(tmp_path: Path) -> None:
    """The recorder is stopped for longer than its ring lasts, as by a disk that does not answer."""
    loaded = load(2)
    shared = ring.create(record_layout(loaded, 200.0), seconds=0.0)
    recording = RecordingObserver(tmp_path / "s.mcap", {})
    recording.attach(RunSetup(loaded, 200.0, shared, None, OnEnd.HOLD, attended=True), os.getpid())
    recorder = _recorder(os.getpid())
    os.kill(recorder, signal.SIGSTOP)
    writer = RingWriter(shared)
    size = writer.layout.packer().size // 8
    for tick in range(1000):
        writer.write([tick, 0, tick / 200.0, *([0] * (size - 3))])
    os.kill(recorder, signal.SIGCONT)

    def missed() -> int:
        recording.watch()
        return recording.missed_ticks

    until(lambda: missed() > 0, "the report")
    assert missed() == 1000 - (256 - 1)
    writer.finish()
    missing = f"{recording.path}: lacks 745 ticks; the disk was too slow for more than 8 s"
    assert [*recording.detach()] == [missing]
    assert recording.lost
    writer.close()
    shared.unlink()


@pytest.mark.realtime
def test_ticks_are_missing_also_where_the_recorder_does_not_end_in_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recording_observer, "COMPACTION_TIMEOUT_S", 0.1)
    loaded = load(2)
    shared = ring.create(record_layout(loaded, 200.0), seconds=0.0)
    recording = RecordingObserver(tmp_path / "s.mcap", {})
    recording.attach(RunSetup(loaded, 200.0, shared, None, OnEnd.HOLD, attended=True), os.getpid())
    process = recording._process
    assert process is not None
    process.send_signal(signal.SIGSTOP)
    writer = RingWriter(shared)
    size = writer.layout.packer().size // 8
    for tick in range(1000):
        writer.write([tick, 0, tick / 200.0, *([0] * (size - 3))])
    process.send_signal(signal.SIGCONT)

    def missed() -> int:
        recording.watch()
        return recording.missed_ticks

    until(lambda: missed() > 0, "the report")
    process.send_signal(signal.SIGSTOP)
    lacks, compacted = recording.detach()
    assert "lacks 745 ticks" in lacks
    assert "still being compacted" in compacted
    assert recording.lost
    writer.finish()
    process.send_signal(signal.SIGCONT)
    assert process.wait(timeout=60) == 0
    writer.close()
    shared.unlink()


@pytest.mark.realtime
def test_a_trajectory_that_the_recorder_cannot_read_is_an_error(tmp_path: Path) -> None:
    loaded = load(2)
    shared = ring.create(record_layout(loaded, 200.0), seconds=0.0)
    recording = RecordingObserver(tmp_path / "s.mcap", {})
    recording.attach(RunSetup(loaded, 200.0, shared, None, OnEnd.HOLD, attended=True), os.getpid())
    recording._send(Attached("trajectory-1", {}, str(tmp_path / "gone.npz")))

    def reported() -> bool:
        recording.watch()
        return bool(recording._errors)

    until(reported, "the report")
    writer = RingWriter(shared)
    writer.finish()
    (error,) = recording.detach()
    assert "trajectory-1: not recorded" in error
    writer.close()
    shared.unlink()


def test_a_recording_whose_file_was_deleted_has_failed_while_it_runs(tmp_path: Path) -> None:
    shared = ring.create(record_layout(load(2), 200.0), seconds=1.0)
    recording = RecordingObserver(tmp_path / "s.mcap", {})
    recording.attach(RunSetup(load(2), 200.0, shared, None, OnEnd.HOLD, attended=True), os.getpid())
    recording.path.unlink()
    until(lambda: recording.failed, "the recorder's end")
    assert [*recording.detach()] == [f"{recording.path}: recording stopped: the file was deleted"]
    assert recording.lost
    shared.unlink()
