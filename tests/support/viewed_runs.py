"""Runs of shipped robots whose drawing is tested."""

from __future__ import annotations

import tempfile
from functools import cache
from pathlib import Path

from contid.control.daemon.run import run
from contid.control.daemon.run_request import RunRequest
from contid_view.observer import ViewerObserver
from contid_view.view_target import Kind, ViewTarget
from tests.support.command import contid

PATHS = {
    "hand": "circle --center 50,70 --radius 8 --period 1",
    "cbha": "circle --size 40 --height 230 --period 1",
    "stiffflop2": "circle --radius 5 --height 110 --period 1",
    "trirack2": "circle --size 40 --height 120 --period 1",
    "chain": "swing --period 2",
}


@cache
def rows_of(robot: str, *more: str) -> str:
    done = contid("path", *PATHS[robot].split(), *more, "--for", robot)
    assert done.returncode == 0, done.stderr
    return done.stdout


def drawn(robot: str, folder: Path) -> Path:
    """The file of `contid run ROBOT --virtual --view` in a folder; the run is made once in this process."""
    recording = folder / f"{robot}.rrd"
    recording.write_bytes(_drawing(robot))
    return recording


@cache
def _drawing(robot: str) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        return _run(robot, Path(folder)).read_bytes()


def _run(robot: str, folder: Path) -> Path:
    """In this process, which has imported Rerun."""
    trajectory, recording = folder / f"{robot}.csv", folder / f"{robot}.rrd"
    trajectory.write_text(rows_of(robot))
    observers = [ViewerObserver(ViewTarget(Kind.FILE, recording))]
    request = RunRequest(robot, trajectory=str(trajectory), mock=True, virtual=True, observers=observers)
    assert run(request).exit_code == 0
    return recording
