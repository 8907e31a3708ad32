"""A daemon beside models of others that crash and hang: no tick and no order of the others is lost."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import psutil
import pytest

from contid.client import Client
from contid.control.tick.faults import Fault
from tests.support.broken.bad_model import IMPORTED, ROBOT, installed_in
from tests.support.fingers import circle_csv, fingers
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime, pytest.mark.slow]

ROOT = Path(__file__).parents[3]
#: What the models do, one after another, and the fault of their robots; test_isolated_models has other kinds.
KINDS = {"segfault": Fault.MODEL_ENDED, "hang with the GIL": Fault.MODEL_TOO_SLOW}


def environment(folder: Path) -> dict[str, str]:
    path = os.pathsep.join(map(str, (folder / "site", ROOT, ROOT / "drivers")))
    return {**os.environ, "PYTHONPATH": path, IMPORTED: str(folder / "imported")}


@pytest.fixture
def started() -> Iterator[tuple[subprocess.Popen[str], Path]]:
    folder = Path(tempfile.mkdtemp(prefix="contid-"))
    text = fingers(1, buses=1 + len(KINDS), options="watchdog_ms: 2000", rate_hz=100)
    for number, how in enumerate(KINDS, start=1):
        text += ROBOT.format(name=f"f{number}", how=how, trigger=folder / f"f{number}", bus=f"bus{number}")
    (folder / "robots.yaml").write_text(text)
    (folder / "circles.csv").write_text(circle_csv(1 + len(KINDS), 60.0, rows=600))
    installed_in(folder / "site")
    process = subprocess.Popen(
        [
            sys.executable, "-m", "contid", "run", "robots.yaml", "--trajectory", "circles.csv",
            "--socket", str(folder / "s"), "--json", "--record", "run.mcap",
        ],
        cwd=folder,
        env=environment(folder),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )  # fmt: skip
    try:
        yield process, folder
    finally:
        process.kill()
        process.communicate()


def robots(client: Client) -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = client.status()["robots"]
    return found


def fails(client: Client, robot: str) -> bool:
    return bool(robots(client)[robot].get("fault"))


def test_no_tick_of_the_others_is_lost_and_the_recording_replays(
    started: tuple[subprocess.Popen[str], Path],
) -> None:
    process, folder = started
    until((folder / "s").exists, "the daemon listens")
    with Client(folder / "s") as client:
        until(lambda: {r["state"] for r in robots(client).values()} == {"RUN"}, "all run")
        skipped = client.status()["skipped"]
        for number, (how, expected) in enumerate(KINDS.items(), start=1):
            robot = f"f{number}"
            (folder / robot).touch()
            until(partial(fails, client, robot), f"{how} is reported")
            assert robots(client)[robot]["fault"]["number"] == expected, how
            began_s = time.monotonic()
            client.estop([robot])  # its model hangs in the daemon as well
            assert time.monotonic() - began_s < 1.0
        status = client.status()
        assert status["robots"]["f0"]["state"] == "RUN"
        assert not status["robots"]["f0"].get("fault")
        assert status["skipped"] == skipped, status["warnings"]
        # Only processes of models have imported the package, beside the daemon that reads the robot file.
        (control,) = [
            child
            for child in psutil.Process(process.pid).children()
            if "contid.control.process" in child.cmdline()
        ]
        imported = {int(line) for line in (folder / "imported").read_text().split()}
        assert process.pid in imported
        assert control.pid not in imported
        assert len(control.children()) == len(KINDS)
        family = psutil.Process(process.pid).children(recursive=True)
        client.stop()
    process.send_signal(2)
    out, _ = process.communicate(timeout=30)
    assert process.returncode == 3
    assert json.loads(out)["robots"]["f1"]["fault"] == Fault.MODEL_ENDED
    _, alive = psutil.wait_procs(family, timeout=3.0)
    assert not alive

    # What did not answer is an event of the recording: a replay, with sound models, asks as little.
    for number in range(1, len(KINDS) + 1):
        (folder / f"f{number}").unlink()
    done = subprocess.run(
        [sys.executable, "-m", "contid", "replay", "run.mcap"],
        cwd=folder,
        env=environment(folder),
        capture_output=True,
        text=True,
        check=False,
        timeout=100,
    )
    assert "bit for bit" in done.stdout, done.stdout + done.stderr
