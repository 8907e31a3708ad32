"""Commands of contid in tests: they fork from a starter, and their sockets are where no other run looks."""

from __future__ import annotations

import io
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import pytest

from contid.control.engine.virtual import run_virtual as engine_run_virtual
from contid.robot_file.load import LoadedFile, load_named, with_mock
from contid.trajectory.read import read_trajectory
from tests.support.command import contid_in
from tests.support.fingers import Collector
from tests.support.plugins import forked


@pytest.fixture(scope="session", autouse=True)
def forked_commands() -> Iterator[None]:
    """``subprocess`` forks commands of contid from a process that has imported it; see tests/README.md."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(subprocess, "Popen", forked.ForkedPopen)
        yield
    forked.close()


@pytest.fixture(autouse=True)
def true_commands(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Commands of a test with the mark `true_process` start as users start them."""
    if request.node.get_closest_marker("true_process"):
        monkeypatch.setattr(subprocess, "Popen", forked.TruePopen)


@pytest.fixture(scope="session", autouse=True)
def own_sockets() -> Iterator[None]:
    """Daemons of this run put their sockets where no other run looks."""
    # Short: the path of a socket has 107 bytes.
    with tempfile.TemporaryDirectory(prefix="contid-") as folder, pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_RUNTIME_DIR", folder)
        yield


@pytest.fixture(scope="session")
def configs() -> Path:
    """Folder of the robot files that ship with contid."""
    return forked.ROOT / "configs"


@pytest.fixture
def contid(tmp_path: Path) -> Callable[..., subprocess.CompletedProcess[str]]:
    """``contid(ARGUMENTS..., stdin=TEXT)`` runs a command in the folder of the test."""
    return partial(contid_in, tmp_path)


@pytest.fixture
def run_virtual() -> Callable[..., Collector]:
    """``run_virtual(ROBOT, ROWS)``: a run in virtual time in this process; what its sink got."""
    return _run_virtual


def _run_virtual(robot: str | LoadedFile, rows: str, rate_hz: float = 200.0) -> Collector:
    """Follow a trajectory on simulated devices.

    Args:
        robot: a shipped robot file by its name, or a loaded one.
        rows: the trajectory as CSV.
        rate_hz: of the tick.
    """
    loaded = with_mock(load_named(robot)) if isinstance(robot, str) else robot
    sink = Collector(loaded)
    trajectory = read_trajectory(io.StringIO(rows), "rows.csv", loaded.driven)
    engine_run_virtual(loaded, rate_hz, trajectory, sinks=[sink])
    return sink
