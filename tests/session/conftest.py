"""One recorded run, compacted and as it was written, for all tests of sessions."""

from __future__ import annotations

from pathlib import Path

import pytest

from contid.control.engine.cycle import OnEnd
from contid.control.process.pipe import RunSetup
from contid.session.write import SessionWriter
from tests.session.rewrite import without_checksums
from tests.session.runs import record_virtual
from tests.support.fingers import circle, load


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A circle of two fingers, compacted."""
    loaded = load(2)
    return record_virtual(tmp_path_factory.mktemp("recorded") / "s.mcap", loaded, circle(loaded))


@pytest.fixture(scope="session")
def growing(tmp_path_factory: pytest.TempPathFactory, recorded: Path) -> Path:
    """The same session before compaction: what a kill leaves, with all its ticks."""
    from contid.control.engine.wiring import record_layout
    from contid.session.format.metadata import describe
    from contid.session.read import Session

    loaded = load(2)
    setup = RunSetup(loaded, 200.0, Path(), circle(loaded), OnEnd.STOP, attended=False)
    path = tmp_path_factory.mktemp("growing") / "s.mcap"
    header = describe(setup, {"mock": "False", "input": "test"}, virtual=True)
    writer = SessionWriter(path, header)
    packer = record_layout(loaded, 200.0).packer()
    for entry in Session(recorded).entries():
        if entry.values is not None:
            writer.tick(packer.unpack(packer.pack(*entry.values)))
        elif entry.event is not None:
            writer.event(entry.event)
        writer.flush()
    writer.finish()
    return path


@pytest.fixture(scope="session")
def plain(tmp_path_factory: pytest.TempPathFactory, growing: Path) -> Path:
    """The same session without checksums: damage in it reaches the decoder of the messages."""
    return without_checksums(growing, tmp_path_factory.mktemp("plain") / "s.mcap")
