"""A daemon beside drivers of others that crash, hang and flood: no tick of the other robots is lost."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import psutil
import pytest

from contid.client import Client
from contid.control.tick.faults import Fault
from tests.support.bad_driver import IMPORTED, installed_in
from tests.support.fingers import fingers
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime, pytest.mark.slow]

ROOT = Path(__file__).parents[3]
#: What the drivers do, one after another, and the fault of their robots; test_isolated_buses has other kinds.
KINDS = {"segfault": Fault.DRIVER_ENDED, "flood of logs": Fault.BUS_STALLED}


@pytest.fixture
def started() -> Iterator[tuple[subprocess.Popen[str], Path]]:
    folder = Path(tempfile.mkdtemp(prefix="contid-"))
    text = fingers(1 + len(KINDS), buses=1 + len(KINDS), options="watchdog_ms: 2000")
    for number, how in enumerate(KINDS, start=1):
        bad = f"driver: bad\n    how: {how}\n    trigger: {folder / f'f{number}'}"
        text = text.replace(f"  bus{number}:\n    driver: sim", f"  bus{number}:\n    {bad}")
    (folder / "robots.yaml").write_text(text)
    path = [installed_in(folder / "site"), ROOT, ROOT / "drivers"]
    process = subprocess.Popen(
        [sys.executable, "-m", "contid", "run", "robots.yaml", "--socket", str(folder / "s"), "--json"],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(map(str, path)), IMPORTED: str(folder / "imported")},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        yield process, folder
    finally:
        process.kill()
        process.communicate()


def faults(client: Client) -> dict[str, dict[str, Any]]:
    robots = client.status()["robots"]
    return {name: robot["fault"] for name, robot in robots.items() if robot.get("fault")}


def reported(client: Client, robot: str) -> bool:
    return robot in faults(client)


def test_no_tick_of_the_others_is_lost(started: tuple[subprocess.Popen[str], Path]) -> None:
    process, folder = started
    until((folder / "s").exists, "the daemon listens")
    with Client(folder / "s") as client:
        until(lambda: {r["state"] for r in client.status()["robots"].values()} == {"HOLD"}, "all hold")
        skipped = client.status()["skipped"]
        for number, (how, expected) in enumerate(KINDS.items(), start=1):
            robot = f"f{number}"
            (folder / robot).touch()
            until(partial(reported, client, robot), f"{how} is reported")
            assert faults(client)[robot]["number"] == expected, how
        status = client.status()
        assert "f0" not in faults(client)
        assert status["robots"]["f0"]["state"] == "HOLD"
        assert status["skipped"] == skipped, status["warnings"]
    # Only processes of buses have imported the driver, beside the daemon that reads the robot file.
    (control,) = [
        child
        for child in psutil.Process(process.pid).children()
        if "contid.control.process" in child.cmdline()
    ]
    imported = {int(line) for line in (folder / "imported").read_text().split()}
    assert process.pid in imported
    assert control.pid not in imported
    keepers = control.children()
    assert len(keepers) == len(KINDS)
    assert not imported & {keeper.pid for keeper in keepers}
    # A control process that is killed takes all of them with it, and what they started.
    family = control.children(recursive=True)
    os.kill(control.pid, signal.SIGKILL)
    _, alive = psutil.wait_procs(family, timeout=3.0)
    assert not alive
    out, _ = process.communicate(timeout=30)
    assert process.returncode == 3
    assert json.loads(out)["robots"]["f1"]["fault"] == Fault.DRIVER_ENDED
