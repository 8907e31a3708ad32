"""A daemon whose stdin is silent: it answers, it ends, and robots that were stopped do not move later."""

from __future__ import annotations

import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from contid.client import Client, RemoteError
from contid.remote.protocol.wire import Code
from tests.support.daemons import Running, command
from tests.support.fingers import circle_csv, fingers
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime]

ROWS = "x_mm,y_mm\n50,75\n"


@contextmanager
def waiting(*arguments: str) -> Iterator[Running]:
    """`contid run` at a pipe that stays open and empty; its socket answers."""
    with tempfile.TemporaryDirectory(prefix="contid-") as name:
        folder = Path(name)
        robot = folder / "fingers.yaml"
        robot.write_text(fingers(1, options=f"journal_file: {folder / 'journal.jsonl'}\n"))
        process = subprocess.Popen(
            command("run", str(robot), "--socket", str(folder / "s"), "--json", *arguments),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        running = Running(process, folder / "s", folder)
        try:
            until(lambda: answering(running), "it answers")
            yield running
        finally:
            process.kill()
            with suppress(ValueError):  # a stdin that the test closed
                process.communicate()


def answering(running: Running) -> bool:
    with suppress(Exception), running.client() as client:
        return bool(client.status()["waiting"])
    return False


def give(running: Running, text: str, *, end: bool = False) -> None:
    assert running.process.stdin is not None
    running.process.stdin.write(text)
    running.process.stdin.flush()
    if end:
        running.process.stdin.close()
        running.process.stdin = None


def state(client: Client) -> str:
    return str(client.status()["robots"]["f0"]["state"])


def test_it_answers_everything_and_begins_when_the_input_comes() -> None:
    with waiting() as running, running.client() as client:
        status = client.status()
        assert status["waiting"] == "waiting for a trajectory on stdin"
        assert status["robots"]["f0"]["state"] == "OFF"
        assert status["lease"]["holder"] == "input"
        assert client.describe()["robots"]["f0"]["axes"]
        assert client.request("subscribe", rate_hz=50)["rate_hz"] == 50
        assert client.clear_fault()["cleared"] == []
        with pytest.raises(RemoteError, match="on stdin; nothing is connected") as refused:
            client.resume()
        assert refused.value.code == Code.REFUSED
        for order in (client.recover, lambda: client.grip(0.5)):
            with pytest.raises(RemoteError, match="on stdin; nothing is connected"):
                order()
        with pytest.raises(RemoteError) as refused:
            client.move({"x_mm": 50.0, "y_mm": 75.0})
        assert refused.value.code == Code.LEASE_HELD
        shown = subprocess.run(
            command("status", "--socket", str(running.socket)), capture_output=True, text=True
        )
        assert "waiting for a trajectory on stdin" in shown.stdout
        assert running.journal() == []
        give(running, ROWS)
        until(lambda: state(client) == "RUN", "it follows")
        assert client.status()["waiting"] is None
        running.end()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_before_anything_was_touched(number: signal.Signals) -> None:
    with waiting() as running:
        running.process.send_signal(number)
        assert running.process.wait(10) == 130
        assert running.journal() == []
        assert not running.socket.exists()


def test_a_trajectory_that_is_still_being_written_is_waited_for_as_well() -> None:
    with waiting() as running, running.client() as client:
        given = circle_csv(1, period_s=0.5)
        give(running, given[: len(given) // 2])
        time.sleep(0.1)
        assert client.status()["waiting"]
        give(running, given[len(given) // 2 :], end=True)
        assert running.process.wait(30) == 0
        assert running.off()


@pytest.mark.parametrize("order", ["hold", "stop", "estop"])
def test_what_was_stopped_before_it_began_waits_for_resume(order: str) -> None:
    with waiting() as running, running.client() as client:
        assert client.request(order)["robots"] == {"f0": "OFF"}
        give(running, ROWS)
        until(lambda: state(client) == "READY", "it connects")
        time.sleep(0.2)
        assert state(client) == "READY"
        assert not any(line["event"] == "enable" for line in running.journal())
        client.resume()
        until(lambda: state(client) == "RUN", "it follows")
        running.end()


def test_a_takeover_makes_it_a_daemon_without_an_input() -> None:
    with waiting() as running, running.client() as client:
        assert client.acquire(takeover=True)["from"] == "input"
        until(lambda: state(client) == "READY", "it connects")
        client.resume()
        client.move({"x_mm": 50.0, "y_mm": 75.0})
        with suppress(BrokenPipeError):
            give(running, ROWS, end=True)
        time.sleep(0.1)
        assert state(client) == "HOLD"
        running.end()


def test_stop_with_end_ends_it() -> None:
    with waiting() as running, running.client() as client:
        with suppress(Exception):  # its answer may be overtaken by the end
            client.stop(end=True)
        assert running.process.wait(10) == 130


def test_a_disarmed_daemon_waits_for_its_input_as_well() -> None:
    with waiting("--disarmed") as running, running.client() as client:
        give(running, ROWS)
        until(lambda: state(client) == "READY", "it connects")
        running.end()


@pytest.mark.parametrize("given", ["", "\n\n", "# no row\n"])
def test_an_input_that_ends_without_a_row_is_an_error_and_nothing_moves(given: str) -> None:
    with waiting() as running:
        give(running, given, end=True)
        _, output = running.process.communicate(timeout=10)
        assert running.process.returncode == 2
        assert "no trajectory came in" in output
        assert running.journal() == []


def test_a_failing_path_before_the_pipe_is_an_error_and_nothing_moves(own_folder: Path) -> None:
    robot = own_folder / "fingers.yaml"
    robot.write_text(fingers(1, options=f"journal_file: {own_folder / 'journal.jsonl'}\n"))
    path = subprocess.Popen(
        command("path", "circle", "--size", "-1", "--for", str(robot)),
        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    assert path.stdout is not None
    done = subprocess.run(
        command("run", str(robot), "--socket", str(own_folder / "s")),
        stdin=path.stdout, capture_output=True, text=True,
    )  # fmt: skip
    path.stdout.close()
    assert path.wait() == 2
    assert done.returncode == 2
    assert "no trajectory came in" in done.stderr
    assert not (own_folder / "journal.jsonl").exists()


def test_dev_null_is_no_input() -> None:
    """What services and `< /dev/null` mean: hold and wait for orders."""
    from tests.support.daemons import armed, daemon

    with daemon() as running, running.client() as client:
        armed(client)
        assert client.status()["waiting"] is None
        assert client.status()["lease"]["holder"] is None
