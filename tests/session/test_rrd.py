"""A session becomes a Rerun recording with the entities its module promises."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.cli.command import contid


# Asked for without an import, which alone starts threads that stay.
@pytest.mark.skipif(find_spec("rerun") is None, reason="needs rerun-sdk")
def test_every_entity_is_there(recorded: Path, tmp_path: Path) -> None:
    path = tmp_path / "s.rrd"
    # In a process of its own: the library keeps threads and sockets for as long as its process lives.
    done = contid("session", "export", str(recorded), "--rrd", str(path))
    assert done.returncode == 0, done.stderr
    data = path.read_bytes()
    for name in ("f0", "f1"):
        for entity in ("backbone", "measured", "target"):
            assert f"/robots/{name}/{entity}".encode() in data
