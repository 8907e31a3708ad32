"""Signals that arrive while a run closes its connections, after the robots have come to rest."""

from __future__ import annotations

import subprocess

import pytest

from tests.support.command import environment, program

pytestmark = pytest.mark.process

#: A run whose source of commands takes a moment to close, and in that moment the signal arrives.
RUN = """
import asyncio, os, signal, sys
from contid.control.daemon.run import run
from contid.control.daemon.run_request import RunRequest

class Source:
    async def serve(self, control):
        control.interrupt()
        try:
            await asyncio.Event().wait()
        finally:
            os.kill(os.getpid(), signal.Signals[sys.argv[1]])
            await asyncio.sleep(0.1)
            print("closed", flush=True)

report = run(RunRequest("hand", mock=True, commands=[Source()]))
print(report.ending)
sys.exit(report.exit_code)
"""


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP", "SIGTSTP"])
def test_a_signal_while_connections_close_ends_nothing_early(name: str) -> None:
    done = subprocess.run(
        program(RUN, name),
        env=environment(),
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert "Traceback" not in done.stderr
    assert done.stdout.split() == ["closed", "interrupted"]
    assert done.returncode == 130
