"""`contid run` as a user meets it: exit codes, signals, bad input, a killed daemon."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import psutil
import pytest

from tests.support.command import contid
from tests.support.fingers import circle_csv, fingers
from tests.support.waiting import until

pytestmark = pytest.mark.realtime


@pytest.fixture
def robot(tmp_path: Path) -> Callable[..., Path]:
    """A robot file whose simulated bus keeps a journal of what its devices did."""

    def write(count: int = 1, options: str = "", **keys: Any) -> Path:
        path = tmp_path / "fingers.yaml"
        lines = f"journal_file: {tmp_path / 'journal.jsonl'}\n{options}"
        path.write_text(fingers(count, options=lines, **keys))
        return path

    return write


def journal(folder: Path) -> list[dict[str, Any]]:
    path = folder / "journal.jsonl"
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


@pytest.fixture
def started() -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Start `contid run`; whatever is left of it afterwards is ended."""
    running: list[subprocess.Popen[str]] = []

    def start(*arguments: str) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [sys.executable, "-m", "contid", "run", *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        running.append(process)
        return process

    yield start
    for process in running:
        process.kill()
        process.communicate()


def feed(process: subprocess.Popen[str], rows: str) -> None:
    """The whole of stdin, and its end."""
    assert process.stdin is not None
    process.stdin.write(rows)
    process.stdin.close()
    process.stdin = None


def enabled(folder: Path) -> Callable[[], bool]:
    return lambda: any(line["event"] == "enable" for line in journal(folder))


def test_real_time_follows_a_circle_and_reports(robot: Callable[..., Path]) -> None:
    done = contid("run", str(robot(2)), "--json", stdin=circle_csv(2, period_s=0.5))
    report = json.loads(done.stdout)
    assert (done.returncode, report["exit_code"]) == (0, 0), done.stderr
    for each in report["robots"].values():
        assert each["mode"] == "OFF"
        assert each["ticks_followed"] > 50
    assert set(report["lateness"]) == {"p50_us", "p99_us", "p99_9_us", "max_us"}


def test_virtual_and_real_time_command_the_same(robot: Callable[..., Path], tmp_path: Path) -> None:
    """Tick by tick the same bytes, as far as no tick was skipped on this machine."""
    path, given = str(robot(1)), circle_csv(1, period_s=0.5)
    logs: list[Any] = []
    skipped = 0
    for virtual in (["--virtual"], []):
        log = tmp_path / f"log{len(logs)}.csv"
        done = contid("run", path, *virtual, "--log", str(log), "--json", stdin=given)
        assert done.returncode == 0, done.stderr
        skipped += json.loads(done.stdout)["skipped"]
        logs.append([line.split(",", 1)[1] for line in log.read_text().splitlines()])
    if skipped == 0:
        assert logs[0] == logs[1]


BAD = {
    "nan": ("t_s,f0.x_mm,f0.y_mm\n0,50,75\n1,nan,75\n", "3:3"),
    "inf": ("t_s,f0.x_mm,f0.y_mm\n0,50,75\n1,50,inf\n", "3:6"),
    "missing column": ("t_s,f0.x_mm\n0,50\n", "1:"),
    "missing cell": ("t_s,f0.x_mm,f0.y_mm\n0,50,75\n1,50\n", "3:"),
    "time backwards": ("t_s,f0.x_mm,f0.y_mm\n0,50,75\n2,50,75\n1,50,75\n", "4:1"),
    "unreachable": ("t_s,f0.x_mm,f0.y_mm\n0,50,75\n1,500,75\n", "3:1"),
    "unknown robot": ("t_s,thumb.x_mm,thumb.y_mm\n0,50,75\n", "1:5"),
    "empty": ("t_s,f0.x_mm,f0.y_mm\n", "1:1"),
}


@pytest.mark.parametrize("name", list(BAD))
def test_bad_input_is_named_and_nothing_moves(name: str, robot: Callable[..., Path], tmp_path: Path) -> None:
    given, place = BAD[name]
    done = contid("run", str(robot(1)), stdin=given)
    assert done.returncode == 2
    assert f"stdin:{place}" in done.stderr
    assert journal(tmp_path) == []


def test_an_unreachable_point_names_its_limit_and_the_distance(robot: Callable[..., Path]) -> None:
    done = contid("run", str(robot(1)), stdin=BAD["unreachable"][0])
    assert "f0: tip (500, 75, 0) mm is out of reach by" in done.stderr
    assert "left.max" in done.stderr


def test_nearest_goes_there_all_the_same(robot: Callable[..., Path]) -> None:
    given = "t_s,f0.x_mm,f0.y_mm\n0,50,75\n2,60,120\n"
    done = contid("run", str(robot(1)), "--virtual", "--unreachable", "nearest", "--json", stdin=given)
    report = json.loads(done.stdout)
    assert done.returncode == 0, done.stderr
    assert report["robots"]["f0"]["ticks_unreachable"] > 0


def test_a_stream_reports_a_bad_row_and_goes_on(robot: Callable[..., Path]) -> None:
    rows = ["f0.x_mm,f0.y_mm", "50,75", "51,x", "52,75", "500,75", "53,75"]
    done = contid("run", str(robot(1)), "--virtual", "--json", stdin="\n".join(rows))
    assert done.returncode == 0, done.stderr
    assert "stdin:3:4" in done.stderr
    assert "stdin:5:1" in done.stderr


def test_a_live_stream_in_real_time_holds_on_bad_rows_and_ends_with_its_input(
    robot: Callable[..., Path], tmp_path: Path, started: Callable[..., Any]
) -> None:
    log = tmp_path / "log.csv"
    process = started(str(robot(1)), "--log", str(log))
    process.stdin.write("f0.x_mm,f0.y_mm\n50,75\n")
    process.stdin.flush()
    until(enabled(tmp_path), "armed")

    def modes() -> list[str]:
        rows = [line.split(",")[2] for line in log.read_text().splitlines()[1:] if line.count(",") == 6]
        return [mode for mode, before in zip(rows, ["", *rows], strict=False) if mode != before]

    for row, mode in (
        ("", "RUN"),
        ("51,oops", "HOLD"),
        ("51,75", "RUN"),
        ("999,75", "HOLD"),
        ("50,75", "RUN"),
    ):
        process.stdin.write(row + "\n" if row else "")
        process.stdin.flush()
        until(lambda mode=mode: modes()[-1:] == [mode], mode)  # type: ignore[misc]
    out, err = process.communicate(timeout=30)
    assert process.returncode == 0, out + err
    assert "stdin:3:4" in err
    assert "stdin:5:1" in err
    assert modes()[-1] == "OFF"


@pytest.mark.parametrize(
    ("last", "message"),
    [
        ("51,oops\n", "holding"),
        ("51,", "may be cut off"),
        ("51,7", "may be cut off"),
        ("999,75\n", "holding"),
    ],
)
@pytest.mark.parametrize("virtual", [False, True], ids=["real", "virtual"])
def test_a_stream_that_ends_on_a_bad_row_reports_it_and_does_not_follow_it(
    last: str, message: str, virtual: bool, robot: Callable[..., Path], tmp_path: Path
) -> None:
    log = tmp_path / "log.csv"
    given = "f0.left_mm,f0.right_mm\n60,75\n" + last
    done = contid("run", str(robot(1)), "--log", str(log), *(["--virtual"] if virtual else []), stdin=given)
    assert done.returncode == 0, done.stderr
    assert "stdin:3:" in done.stderr
    assert message in done.stderr
    head, *lines = [line.split(",") for line in log.read_text().splitlines()]
    commands = [cell for line in lines if (cell := line[head.index("f0.right.command")])]
    assert all(float(command) > 0.05 for command in commands)


def test_a_device_that_is_not_there_is_exit_code_4(robot: Callable[..., Path]) -> None:
    path = robot(1, options="faults: [{at_s: 0.0, kind: lost}]")
    done = contid("run", str(path), stdin=circle_csv(1))
    assert done.returncode == 4
    assert "bus0" in done.stdout


def test_a_fault_is_exit_code_3_and_reports(robot: Callable[..., Path]) -> None:
    path = robot(2, options="faults: [{at_s: 0.3, kind: overload, axis: f0.left}]")
    done = contid("run", str(path), "--json", stdin=circle_csv(2, period_s=0.6))
    report = json.loads(done.stdout)
    assert done.returncode == 3
    assert report["robots"]["f0"]["fault"] == 103
    assert "clear-fault" in report["robots"]["f0"]["message"]
    assert report["ticks"] > 0


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_one_signal_is_an_orderly_stop(
    number: signal.Signals, robot: Callable[..., Path], tmp_path: Path, started: Callable[..., Any]
) -> None:
    process = started(str(robot(1, on_interrupt="rest")), "--on-end", "hold")
    feed(process, circle_csv(1, period_s=60.0))
    until(enabled(tmp_path), "armed")
    time.sleep(0.3)
    process.send_signal(number)
    out, _ = process.communicate(timeout=30)
    assert process.returncode == 130
    assert "run: interrupted" in out
    last = journal(tmp_path)[-1]
    assert last["event"] == "close"
    for axis in last["axes"].values():
        assert axis["rest"] == "hold"
        assert axis["goal_rad"] == pytest.approx(60.0 / 37.7 * 2 * 3.141592653589793, abs=1e-3)


def test_the_second_signal_relaxes_at_once(
    robot: Callable[..., Path], tmp_path: Path, started: Callable[..., Any]
) -> None:
    process = started(str(robot(1, on_interrupt="rest")))
    feed(process, circle_csv(1, period_s=60.0))
    until(enabled(tmp_path), "armed")
    time.sleep(0.4)
    process.send_signal(signal.SIGINT)
    time.sleep(0.1)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=30)
    assert process.returncode == 130
    rests = {axis["rest"] for line in journal(tmp_path)[-1:] for axis in line["axes"].values()}
    assert rests == {"relax"}


def test_repeated_hangups_of_a_closed_terminal_are_one_orderly_stop(
    robot: Callable[..., Path], tmp_path: Path, started: Callable[..., Any]
) -> None:
    process = started(str(robot(1, on_interrupt="rest")), "--on-end", "hold")
    feed(process, circle_csv(1, period_s=60.0))
    until(enabled(tmp_path), "armed")
    time.sleep(0.3)
    for _ in range(2):
        process.send_signal(signal.SIGHUP)
        time.sleep(0.05)
    process.communicate(timeout=30)
    assert process.returncode == 130
    assert {axis["rest"] for axis in journal(tmp_path)[-1]["axes"].values()} == {"hold"}


@pytest.mark.parametrize("full", [False, True], ids=["reader gone", "reader that does not read"])
def test_a_full_or_closed_stderr_does_not_delay_the_stop(
    full: bool, robot: Callable[..., Path], tmp_path: Path
) -> None:
    reader, writer = os.pipe()
    if full:
        os.set_blocking(writer, False)
        with suppress(BlockingIOError):
            while True:
                os.write(writer, b"." * 4096)
        os.set_blocking(writer, True)
    command = [sys.executable, "-m", "contid", "run", str(robot(1)), "--socket", str(tmp_path / "s")]
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=writer)
    os.close(writer)
    try:
        until(enabled(tmp_path), "armed")
        if not full:
            os.close(reader)
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=10)
    finally:
        process.kill()
        process.wait()
        if full:
            os.close(reader)
    assert process.returncode == 130
    assert b"run: interrupted" in out


def test_a_log_that_cannot_be_written_any_more_ends_and_the_run_goes_on(
    robot: Callable[..., Path], tmp_path: Path, started: Callable[..., Any]
) -> None:
    log = tmp_path / "log.csv"
    os.mkfifo(log)
    reader = os.open(log, os.O_RDONLY | os.O_NONBLOCK)
    process = started(str(robot(1)), "--log", str(log))
    feed(process, circle_csv(1, period_s=1.0))
    until(enabled(tmp_path), "armed")
    os.close(reader)
    out, _ = process.communicate(timeout=30)
    assert process.returncode == 0
    assert "log.csv: the command log ends here, the run continues: Broken pipe" in out


def test_a_run_whose_socket_died_stops_orderly(robot: Callable[..., Path], tmp_path: Path) -> None:
    script = f"""
import asyncio
from contid.control.engine.tick_layout import ENABLED
from contid.control.daemon.run import RunRequest, run

class Dying:
    async def serve(self, orders):
        while orders.newest() is None or not orders.newest().robots[0].flags & ENABLED:
            await asyncio.sleep(0.01)
        raise OSError("gone")

report = run(RunRequest(robot_file={str(robot(1, on_interrupt="rest"))!r}, commands=[Dying()]))
print(report)
raise SystemExit(report.exit_code)
"""
    done = subprocess.run(
        [sys.executable, "-c", script], stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 3, done.stderr
    assert "run: a source of commands ended early: OSError: gone" in done.stdout
    assert {axis["rest"] for axis in journal(tmp_path)[-1]["axes"].values()} == {"hold"}


def test_killing_the_daemon_brings_the_robot_to_on_host_loss(
    robot: Callable[..., Path], tmp_path: Path, started: Callable[..., Any]
) -> None:
    process = started(str(robot(1)))
    feed(process, circle_csv(1, period_s=60.0))
    until(enabled(tmp_path), "armed")
    time.sleep(0.3)
    (control,) = psutil.Process(process.pid).children()
    process.kill()
    process.wait()
    control.wait(timeout=10)
    last = journal(tmp_path)[-1]
    assert last["event"] == "close"
    assert {axis["rest"] for axis in last["axes"].values()} == {"relax"}
    assert not any("trip" in line["event"] for line in journal(tmp_path))
    assert not list(Path("/dev/shm").glob(f"contid-{process.pid}-*"))


def test_a_control_process_that_hangs_is_ended_all_the_same(
    robot: Callable[..., Path], tmp_path: Path, started: Callable[..., Any]
) -> None:
    """A bus that never comes back holds up the tick for ever; Ctrl-C still ends the run, and it reports."""
    late = "faults: [{at_s: 0.6, kind: late, delay_ms: 600000}]"
    process = started(str(robot(1, options=late)), "--json")
    feed(process, circle_csv(1, period_s=60.0))
    until(lambda: any("late" in line["event"] for line in journal(tmp_path)), "stuck")
    process.send_signal(signal.SIGINT)
    out, _ = process.communicate(timeout=30)
    report = json.loads(out)
    assert process.returncode == report["exit_code"] == 3
    assert report["ticks"] > 0
    assert report["robots"]["f0"]["mode"] in ("APPROACH", "RUN")
    assert any("watchdog" in problem for problem in report["problems"])
