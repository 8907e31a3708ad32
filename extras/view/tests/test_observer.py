"""The observer of a viewer whose process ends at once."""

from __future__ import annotations

import os
from pathlib import Path

import psutil
import pytest

from contid.control.engine.cycle import OnEnd
from contid.control.engine.wiring import record_layout
from contid.control.process.pipe import RunSetup
from contid.control.process.ring import create
from contid.robot_file.load import load_robot_file
from contid_view.observer import ViewerObserver
from contid_view.view_target import Kind, ViewTarget
from tests.support.waiting import until

pytestmark = pytest.mark.process


def test_a_viewer_that_has_ended_leaves_no_pipe_open(
    tmp_path: Path, configs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    loaded = load_robot_file(configs / "hand.yaml")
    ring, drawing = create(record_layout(loaded, 200.0), seconds=1.0), tmp_path / "run.rrd"
    observer = ViewerObserver(ViewTarget(Kind.FILE, drawing))
    monkeypatch.setattr("contid_view.observer.module_command", lambda module: ["false"])

    def late(job: object) -> bytes:
        process = psutil.Process(observer.pid)
        until(lambda: process.status() == psutil.STATUS_ZOMBIE, "it has ended")
        return bytes(100_000)  # more than a buffer takes

    monkeypatch.setattr("contid_view.observer.pickle.dumps", late)
    observer.attach(RunSetup(loaded, 200.0, ring, None, OnEnd.STOP, attended=False), os.getpid())
    ring.unlink()
    assert observer._process is not None
    assert observer._process.stdin is not None
    assert observer._process.stdin.closed
    (problem,) = observer.detach()
    assert problem == f"the viewer ended with status 1; {drawing} is missing"
    assert observer.lost
