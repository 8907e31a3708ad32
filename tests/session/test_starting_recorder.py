"""An order to play that arrives while the process of a recorder is being started."""

from __future__ import annotations

import asyncio
import io
import pickle
import threading
from collections.abc import Mapping
from pathlib import Path

import pytest

from contid.control.engine.cycle import OnEnd
from contid.control.engine.messages import Play
from contid.control.process.pipe import RunSetup
from contid.session.format.header import Header, RecorderJob
from contid.session.format.metadata import describe
from contid.session.mcap_recorder import READY
from contid.session.recordings import Recordings
from tests.support.fingers import circle, load


class Recorder:
    """The process of a recorder, as far as it is started; what it gets is kept."""

    def __init__(self, *_: object, **__: object) -> None:
        started.append(self)
        self.stdin = io.BytesIO()
        self.stdout = io.BytesIO(f"{READY}\n".encode())
        self.stdout.fileno = lambda: 0  # type: ignore[method-assign]

    def poll(self) -> None:
        """It runs."""


started: list[Recorder] = []


async def test_its_job_comes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    reached, ordered = threading.Event(), threading.Event()

    def slow(setup: RunSetup, options: Mapping[str, str], virtual: bool, host: str | None = None) -> Header:
        reached.set()
        ordered.wait(60.0)
        return describe(setup, options, virtual, host)

    monkeypatch.setattr("contid.session.recording_observer.subprocess.Popen", Recorder)
    monkeypatch.setattr("contid.session.recording_observer.os.set_blocking", lambda *_: None)
    monkeypatch.setattr("contid.session.recording_observer.describe", slow)
    loaded = load(1)
    recordings = Recordings(tmp_path, {})
    recordings.attach(RunSetup(loaded, 200.0, tmp_path / "ring", None, OnEnd.HOLD, attended=True), 1)
    begun = asyncio.create_task(recordings.begin("person"))
    await asyncio.to_thread(reached.wait, 60.0)
    recordings.before_order(Play(circle(loaded)))
    ordered.set()
    assert (await begun).done
    (recorder,) = started
    assert isinstance(pickle.loads(recorder.stdin.getvalue()), RecorderJob)
