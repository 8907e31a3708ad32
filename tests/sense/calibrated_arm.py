"""An arm that was calibrated in a session without load, by the commands of a user: once for all workers."""

import fcntl
import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from contid.robot_file.load import load_named
from tests.sense.commands import SIM, contid, rests

#: Of the robot file, whose own rate is 500 Hz; measurements come at 50 Hz.
RATE_HZ = 100


def calibrated_arm(factory: pytest.TempPathFactory, name: str) -> Path:
    """A folder with ``arm.yaml``, and ``empty.mcap`` with 24 rests without load that calibrated it."""
    own = factory.getbasetemp()
    shared = (own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "calibrated-arm"
    shared.mkdir(exist_ok=True)
    with (shared / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (shared / "done").exists():
            _calibrate(shared)
    folder = factory.mktemp(name)
    for file in ("arm.yaml", "empty.mcap"):
        shutil.copy(shared / file, folder)
    return folder


def _calibrate(folder: Path) -> None:
    text = load_named("stiffflop2").text.replace("rate_hz: 500", f"rate_hz: {RATE_HZ}", 1)
    assert "\n    stop: {on_end" in text
    (folder / "arm.yaml").write_text(
        text.replace("    stop: {on_end", SIM.format(grams=0) + "    stop: {on_end", 1)
    )
    rests(folder / "many.csv", np.random.default_rng(4).uniform(0.05, 1.2, (24, 6)))
    contid(folder, "run", "arm.yaml", "--virtual", "--trajectory", "many.csv", "--record", "empty.mcap")
    done = contid(folder, "calibrate", "load", "empty.mcap", "--write", "arm.yaml")
    assert "24 rests without load" in done.stdout
    assert "written to arm.yaml" in done.stderr
    (folder / "done").touch()
