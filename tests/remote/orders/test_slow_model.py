"""A daemon beside a model that answers slowly: the others are served and stopped while it is asked."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from contid.client import Client
from contid.remote.protocol.wire import decode, encode
from contid.remote.server.turns import MAX_PENDING
from tests.support.broken.bad_model import ROBOT
from tests.support.broken.slow_model import installed_in
from tests.support.daemons import Running, armed, listening, raw, states
from tests.support.fingers import fingers
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime]

ROOT = Path(__file__).parents[3]
#: Time of a search [ms]: below what a question may take, so each has its answer.
SEARCH_MS = 60
ROWS = 8


@contextmanager
def slow_daemon(stdin: int = subprocess.DEVNULL) -> Iterator[Running]:
    """A finger, and a robot whose model searches slowly for what is out of reach."""
    folder = Path(tempfile.mkdtemp(prefix="contid-"))
    robot = ROBOT.format(name="f1", how=f'"{SEARCH_MS}"', trigger=folder / "trigger", bus="bus1")
    journal = f"journal_file: {folder / 'journal.jsonl'}"
    text = fingers(1, buses=2, options=f"watchdog_ms: 2000\n{journal}", rate_hz=100)
    (folder / "robots.yaml").write_text(text + robot)
    installed_in(folder / "site")
    path = os.pathsep.join(map(str, (folder / "site", ROOT, ROOT / "drivers")))
    process = subprocess.Popen(
        [sys.executable, "-m", "contid", "run", "robots.yaml", "--socket", str(folder / "s")],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": path},
        stdin=stdin,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    with listening(process, folder) as running:
        yield running


@pytest.fixture(scope="module")
def slow() -> Iterator[Running]:
    """It waits for orders."""
    with slow_daemon() as running:
        with running.client() as client:
            armed(client)
        yield running
        running.end()


def test_a_stop_of_another_client_does_not_wait_for_rows_under_check(slow: Running) -> None:
    """Eight rows out of reach take half a second to check."""
    with slow.client(name="person") as person, raw(slow) as program:
        answers = program.makefile("rb")

        def result(line: dict[str, Any]) -> Any:
            program.sendall(encode(line))
            while (answer := decode(answers.readline())).get("id") != line["id"]:
                pass
            return answer["result"]

        begun = result({"id": 1, "verb": "move", "columns": ["f1.x_mm", "f1.y_mm"]})
        rows = [[150.0 + 0.1 * number, 50.0] for number in range(ROWS)]
        program.sendall(encode({"id": 2, "verb": "rows", "move": begun["move"], "rows": rows}))
        time.sleep(0.05)
        began_s = time.monotonic()
        person.ping()
        person.hold("f0")
        took_s = time.monotonic() - began_s
        answers.close()
    assert took_s < 0.5 * ROWS * 1e-3 * SEARCH_MS


def test_a_hold_does_not_wait_behind_more_moves_than_are_checked_at_once(slow: Running) -> None:
    """Each is out of reach and checked for `SEARCH_MS`: the first 32 for 2 s."""
    moves = MAX_PENDING + 30
    with raw(slow) as program:
        answers = program.makefile("rb")
        orders = [
            {"id": n, "verb": "move", "target": {"f1.x_mm": 150.0, "f1.y_mm": 50.0}} for n in range(moves)
        ]
        began_s = time.monotonic()
        program.sendall(b"".join(map(encode, [*orders, {"id": moves, "verb": "hold", "robots": ["f0"]}])))
        codes: dict[int, str] = {}
        while len(codes) <= moves:
            answer = decode(answers.readline())
            if "id" in answer:
                codes[answer["id"]] = "ok" if answer["ok"] else answer["error"]["code"]
                took_s = time.monotonic() - began_s
        answers.close()
    assert took_s < 0.5 * MAX_PENDING * 1e-3 * SEARCH_MS
    assert codes.pop(moves) == "ok"
    assert set(codes.values()) <= {"stopped", "unreachable"}
    assert list(codes.values()).count("unreachable") < MAX_PENDING / 2


def test_frames_of_the_others_do_not_wait(slow: Running) -> None:
    """The model takes its time for tips too; frames without its robot come at their rate."""
    with slow.client() as client, Client(slow.socket) as other:
        with_slow = other.telemetry(100.0, fields=["tip_mm", "command_tip_mm"])
        next(with_slow)
        (slow.folder / "trigger").touch()
        time.sleep(0.2)
        frames = client.telemetry(100.0, robots="f0", fields=["tip_mm"])
        next(frames)
        began_s = time.monotonic()
        count = sum(1 for _, _ in zip(range(40), frames, strict=False))
        assert (time.monotonic() - began_s) / count < 1e-3 * SEARCH_MS / 2
        assert next(with_slow)["robots"].keys() == {"f0", "f1"}


def test_no_row_of_stdin_follows_a_takeover_during_its_check() -> None:
    """f1's part of each row is out of reach: its check takes its time, while f0 waits for its part."""
    with slow_daemon(subprocess.PIPE) as running, running.client(name="person") as person:
        stdin = running.process.stdin
        assert stdin is not None

        def row(x_mm: float) -> None:
            stdin.write(f"{x_mm},75,150,50\n")
            stdin.flush()

        stdin.write("f0.x_mm,f0.y_mm,f1.x_mm,f1.y_mm\n")
        row(50.0)
        until(lambda: person.status()["robots"]["f0"]["state"] == "RUN", "the first row is followed")
        for number in range(ROWS):
            row(50.1 + 0.1 * number)
        row(40.0)
        time.sleep(0.2e-3 * SEARCH_MS)  # the check of the last rows goes on
        person.acquire(20.0, takeover=True)
        until(lambda: states(person) == {"HOLD"}, "the robots hold")
        before_mm = person.status()["robots"]["f0"]["tip_mm"]
        for _ in range(20):
            row(40.0)
        person.move({"f1.x_mm": 45.0, "f1.y_mm": 50.0})
        until(lambda: states(person) == {"HOLD"}, "it has moved")
        assert person.status()["robots"]["f0"]["tip_mm"] == pytest.approx(before_mm, abs=0.3)
        stdin.close()
        running.process.stdin = None
        _, later = running.end().split("took over", 1)
    assert later.count("out of reach") <= 1, "rows of an input that nothing follows are checked and reported"
