"""Daemons whose control process ends: what it is, how it ends, and a driver that makes it misbehave."""

from __future__ import annotations

import json
import os
from pathlib import Path

import psutil
import pytest

from tests.support.command import environment
from tests.support.daemons import Running
from tests.support.plugins.starter import LATE

#: Runs in the control process only, before anything else; its simulated bus is then that of a bad library.
LIBRARY = """\
import sys
if "contid.control.process" in sys.orig_argv:
    import os
    from contid_drivers.sim.bus import SimBus
    exchange, calls = SimBus.exchange, 0
    def bad(self, commands):
        global calls
        calls += 1
        if calls == 100:
            {does}
        return exchange(self, commands)
    SimBus.exchange = bad
"""


def at_start(monkeypatch: pytest.MonkeyPatch, folder: Path, code: str) -> None:
    """Have the processes of a daemon run code of a folder before all else."""
    (folder / "sitecustomize.py").write_text(LATE + code)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join((str(folder), environment()["PYTHONPATH"])))


def control_of(running: Running) -> int:
    """The process id of the control process."""
    (control,) = [
        child.pid
        for child in psutil.Process(running.process.pid).children()
        if "contid.control.process" in child.cmdline()
    ]
    return control


def ended(running: Running) -> tuple[int, str, str]:
    """Exit code of the daemon, the ending in its report, and its messages."""
    out, messages = running.process.communicate(timeout=30)
    return running.process.returncode, json.loads(out)["ending"], messages
