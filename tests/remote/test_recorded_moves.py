"""Timed moves of a recorded run whose recorder or memory is gone: answered, followed, nothing left behind."""

from __future__ import annotations

import os
import resource

import psutil
import pytest

from contid.control.process.shared_files import folder
from tests.support.daemons import armed
from tests.support.daemons import fast_daemon as daemon

pytestmark = [pytest.mark.process, pytest.mark.realtime]

COLUMNS = ["t_s", "x_mm", "y_mm"]
ROWS = [[0.005 * n, 50.0, 75.0] for n in range(40)]


@pytest.mark.parametrize("gone", ["recorder", "space"])
def test_a_timed_move_is_answered(gone: str, tmp_path: pytest.TempPathFactory) -> None:
    with daemon(1, "--record", f"{tmp_path}/s.mcap") as running, running.client() as client:
        armed(client)
        daemons = psutil.Process(running.process.pid)
        if gone == "recorder":
            (recorder,) = [
                each for each in daemons.children() if "contid.session.mcap_recorder" in each.cmdline()
            ]
            recorder.kill()
        else:  # as with a full /dev/shm: this process writes no file any more
            resource.prlimit(daemons.pid, resource.RLIMIT_FSIZE, (0, resource.RLIM_INFINITY))
        for _ in range(2):
            client.stream(COLUMNS, ROWS)
        resource.prlimit(daemons.pid, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
        output = running.end(None)
        assert "Traceback" not in output
        assert gone == "recorder" or "lacks the trajectory of a move" in output
    left = [path.name for path in folder().glob(f"contid-{daemons.pid}-*") if os.access(path, os.F_OK)]
    assert left == []
