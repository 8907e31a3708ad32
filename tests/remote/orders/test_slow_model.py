"""A daemon beside a model that answers slowly: the others are served and stopped while it is asked."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from contid.client import Client
from contid.remote.protocol.wire import decode, encode
from tests.support.broken.bad_model import ROBOT
from tests.support.broken.slow_model import installed_in
from tests.support.daemons import Running, armed, listening, raw
from tests.support.fingers import fingers

pytestmark = [pytest.mark.process, pytest.mark.realtime]

ROOT = Path(__file__).parents[3]
#: Time of a search [ms]: below what a question may take, so each has its answer.
SEARCH_MS = 60
ROWS = 8


@pytest.fixture(scope="module")
def slow() -> Iterator[Running]:
    """A finger, and a robot whose model searches slowly for what is out of reach."""
    folder = Path(tempfile.mkdtemp(prefix="contid-"))
    robot = ROBOT.format(name="f1", how=f'"{SEARCH_MS}"', trigger=folder / "trigger", bus="bus1")
    text = fingers(1, buses=2, options="watchdog_ms: 2000", rate_hz=100)
    (folder / "robots.yaml").write_text(text + robot)
    installed_in(folder / "site")
    path = os.pathsep.join(map(str, (folder / "site", ROOT, ROOT / "drivers")))
    process = subprocess.Popen(
        [sys.executable, "-m", "contid", "run", "robots.yaml", "--socket", str(folder / "s")],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": path},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    with listening(process, folder) as running:
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
