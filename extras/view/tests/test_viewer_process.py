"""The viewer of a real daemon is a process that never disturbs a tick; its page and window."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import tempfile
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import closing
from functools import cache
from pathlib import Path
from typing import IO

import psutil
import pytest

from contid.control.engine.cycle import OnEnd
from contid.control.engine.wiring import record_layout
from contid.control.process.pipe import RunSetup
from contid.control.process.ring import create
from contid.control.process.ring_reader import RingReader
from contid.control.process.ring_writer import RingWriter
from contid.robot_file.load import load_robot_file
from contid_view.csp_proxy import POLICY, CspProxy
from contid_view.observer import ViewerObserver
from contid_view.rerun.program import rerun_program
from contid_view.rerun.session import RerunSession
from contid_view.view_target import Kind, ViewerJob, ViewTarget
from contid_view.viewer_process import Viewer
from tests.support.command import contid
from tests.support.rerun_entities import entities
from tests.support.viewed_runs import drawn, rows_of
from tests.support.waiting import until

pytestmark = pytest.mark.process


@pytest.fixture(scope="module", autouse=True)
def what_rerun_keeps(tmp_path_factory: pytest.TempPathFactory, configs: Path) -> None:
    """The first recording with a layout in a process opens what Rerun keeps for all others."""
    target = ViewTarget(Kind.FILE, tmp_path_factory.mktemp("first") / "first.rrd")
    RerunSession(target, load_robot_file(configs / "hand.yaml"), 200.0, live=False).close()


@pytest.fixture
def started() -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Start a command; one that a failed test leaves running is ended, the next needs its socket."""
    running: list[subprocess.Popen[str]] = []

    def start(*arguments: str) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [sys.executable, "-m", "contid", *arguments],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        running.append(process)
        return process

    yield start
    for process in running:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        if process.stdout is not None and not process.stdout.closed:
            process.communicate(timeout=30)


def line_with(stream: IO[str] | None, text: str) -> str:
    """The first line with a text; lines about skipped ticks may come before."""
    assert stream is not None
    before = []
    for line in stream:
        if text in line:
            return line
        before.append(line)
    raise AssertionError(f"never: {text}; but {before}")


def children_with(process: subprocess.Popen[str], text: str) -> list[psutil.Process]:
    found = []
    for child in psutil.Process(process.pid).children(recursive=True):
        try:
            if text in " ".join(child.cmdline()):
                found.append(child)
        except psutil.NoSuchProcess:
            continue
    return found


def commands(log: Path) -> list[str]:
    """Lines of a command log without the number of the tick, which depends on the start of the run."""
    return [line.partition(",")[2] for line in log.read_text().splitlines()]


@cache
def logged_alone(rows: str) -> str:
    """The command log of a run of the hand in virtual time."""
    with tempfile.TemporaryDirectory() as folder:
        log, trajectory = Path(folder, "alone.csv"), Path(folder, "circle.csv")
        trajectory.write_text(rows)
        done = contid("run", "hand", "--virtual", "--log", str(log), "--trajectory", str(trajectory))
        assert done.returncode == 0, done.stderr
        return log.read_text()


@pytest.mark.realtime
@pytest.mark.parametrize("number", [signal.SIGSTOP, signal.SIGKILL])
def test_a_stalled_or_killed_viewer_changes_no_command(
    number: signal.Signals, tmp_path: Path, started: Callable[..., subprocess.Popen[str]]
) -> None:
    """Without a skipped tick the commands of a real run are those of virtual time, bit for bit.

    The file is cut: that is in the report and in the exit code.
    """
    trajectory, rrd = tmp_path / "circle.csv", tmp_path / "run.rrd"
    trajectory.write_text(rows_of("hand"))
    alone, viewed = tmp_path / "alone.csv", tmp_path / "viewed.csv"
    source = ["--trajectory", str(trajectory)]
    alone.write_text(logged_alone(trajectory.read_text()))
    process = started("run", "hand", "--mock", "--log", str(viewed), "--view", str(rrd), *source)
    until(rrd.exists, "a file")
    children_with(process, "contid_view.viewer_process")[0].send_signal(number)
    output, errors = process.communicate(timeout=60)
    assert process.returncode == 1, errors
    assert "but the file of --view is incomplete" in output
    assert f"; {rrd} has no end" in output  # the report names the viewer's end
    assert commands(viewed) == commands(alone)


@pytest.mark.realtime
def test_a_viewer_that_was_stopped_reports_the_ticks_it_missed(tmp_path: Path, configs: Path) -> None:
    loaded = load_robot_file(configs / "hand.yaml")
    layout = record_layout(loaded, 200.0)
    ring, rrd = create(layout, seconds=1.0), tmp_path / "run.rrd"
    reader, writer = RingReader(ring), RingWriter(ring)
    viewer = Viewer(ViewerJob(ViewTarget(Kind.FILE, rrd), ring, os.getpid(), loaded, 200.0), reader)
    try:
        blank = layout.packer().unpack(bytes(layout.packer().size))
        for tick in range(1000):
            writer.write([tick, *blank[1:]])
        writer.finish()
        viewer.run()
    finally:
        viewer.close()
        reader.close()
        writer.close()
        ring.unlink()
    there = entities(rrd)
    assert there["events"] == 1  # that of the missed ticks
    assert 30 <= there["plots/timing"] <= 45  # the frames of the ticks left in the ring


@pytest.mark.realtime
def test_a_viewer_that_starts_after_the_run_still_writes_its_file(tmp_path: Path, configs: Path) -> None:
    """On a busy machine a short run has ended, and its ring is removed, before the viewer has imported."""
    loaded = load_robot_file(configs / "hand.yaml")
    layout = record_layout(loaded, 200.0)
    ring, rrd = create(layout, seconds=1.0), tmp_path / "run.rrd"
    observer = ViewerObserver(ViewTarget(Kind.FILE, rrd))
    with closing(RingWriter(ring)) as writer:
        observer.attach(RunSetup(loaded, 200.0, ring, None, OnEnd.STOP, attended=False), os.getpid())
        ring.unlink()  # long before the imports are done
        for tick in range(100):
            writer.write([tick, *layout.packer().unpack(bytes(layout.packer().size))[1:]])
        writer.finish()
    assert observer.detach() == ()
    assert not observer.lost
    assert entities(rrd)["plots/timing"] > 10


@pytest.mark.realtime
def test_the_served_page_is_on_loopback_and_under_a_policy(
    tmp_path: Path, started: Callable[..., subprocess.Popen[str]]
) -> None:
    process = started("view", "--serve", str(drawn("hand", tmp_path)))
    url = line_with(process.stdout, "http").strip()
    assert url.startswith("http://127.0.0.1:")
    family = [psutil.Process(process.pid), *psutil.Process(process.pid).children(recursive=True)]
    listening = [c.laddr.ip for p in family for c in p.net_connections() if c.status == psutil.CONN_LISTEN]
    assert len(listening) >= 3
    assert set(listening) == {"127.0.0.1"}
    with urllib.request.urlopen(url) as answer:
        assert b"Rerun" in answer.read()
        rules = answer.headers["Content-Security-Policy"]
    port = int(re.findall(r":(\d+)/", url)[0])
    assert int(re.findall(r"%3A(\d+)%2Fproxy", url)[0]) == port  # the data come through the same server
    assert rules == POLICY
    assert "https" not in rules
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=30)
    assert process.returncode == 0
    assert not [each for each in family if each.is_running() and each.status() != psutil.STATUS_ZOMBIE]


@pytest.mark.realtime
def test_a_page_of_a_running_robot_is_served_when_nothing_else_runs(
    tmp_path: Path, started: Callable[..., subprocess.Popen[str]]
) -> None:
    """Policy and nice value of every thread, as the kernel reports them; the page ends with the run."""
    trajectory = tmp_path / "circle.csv"
    trajectory.write_text(rows_of("hand"))
    source = ("--trajectory", str(trajectory), "--on-end", "hold")
    process = started("run", "hand", "--mock", "--view", "serve", *source)
    url = line_with(process.stderr, "view: http://127.0.0.1:").split("view: ")[1].strip()
    with urllib.request.urlopen(url) as answer:
        assert answer.status == 200
    viewers = children_with(process, "contid_view.viewer_process")
    servers = children_with(process, "--serve-web")
    assert viewers
    assert servers
    for each in (*viewers, *servers):
        threads = list(Path(f"/proc/{each.pid}/task").iterdir())
        assert threads
        for thread in threads:
            # After the name in parentheses: state is field 3, nice 19, policy 41 (proc(5)).
            fields = (thread / "stat").read_text().rpartition(")")[2].split()
            assert (int(fields[19 - 3]), int(fields[41 - 3])) == (10, os.SCHED_IDLE), each.cmdline()
    (control,) = children_with(process, "contid.control.process")
    assert os.sched_getscheduler(control.pid) & ~os.SCHED_RESET_ON_FORK in (os.SCHED_FIFO, os.SCHED_OTHER)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=60)
    assert process.returncode == 130
    with pytest.raises(OSError, match="refused"):
        urllib.request.urlopen(url)


def test_a_page_without_a_server_behind_it_answers_502() -> None:
    page = CspProxy(0, 1, 2)  # no server listens on port 1
    try:
        with pytest.raises(urllib.error.HTTPError, match="502") as caught:
            urllib.request.urlopen(page.url)
        caught.value.close()
    finally:
        page.close()


def test_a_run_without_a_viewer_does_not_import_rerun() -> None:
    """Neither the daemon nor the modules it imports for ``--view`` import Rerun."""
    code = "import sys, contid.control.daemon.run, contid_view.observer; print('rerun' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


@pytest.mark.realtime
@pytest.mark.parametrize(("display", "message"), [(None, "no display"), (":4711", "no window: ")])
def test_a_run_goes_on_without_a_window(
    display: str | None, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No display, or one that does not answer: the reason is printed and the run goes on."""
    recording = drawn("hand", tmp_path)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.delenv("DISPLAY", raising=False)
    if display is not None:
        monkeypatch.setenv("DISPLAY", display)
    laps = ("--laps", "4") if display else ()  # time enough for a program of 300 MB to start and fail
    done = contid("run", "hand", "--mock", "--view", "spawn", stdin=rows_of("hand", *laps))
    assert done.returncode == 0
    assert message in done.stderr
    assert ("the viewer ended with status 2" in done.stdout) == (display is not None)
    looked = contid("view", str(recording))
    assert looked.returncode == 2
    assert message in looked.stderr


def test_invalid_targets_are_refused_before_the_run_starts(tmp_path: Path) -> None:
    there = tmp_path / "there.rrd"
    there.write_bytes(b"")
    for view, message in (
        ("window", "spawn"),
        (str(there), "never overwritten"),
        (str(tmp_path / "no" / "such.rrd"), "no such folder"),
    ):
        done = contid("run", "hand", "--mock", "--view", view, stdin=rows_of("hand"))
        assert done.returncode == 2
        assert message in done.stderr


def test_the_environment_disables_the_statistics_of_rerun() -> None:
    assert Path(rerun_program()).name == "rerun"
    done = subprocess.run(
        [rerun_program(), "--version"],
        capture_output=True, text=True, env={**os.environ, "CI": "1", "RUST_LOG": "re_analytics=debug"},
    )  # fmt: skip
    assert "Analytics disabled" in done.stdout + done.stderr
