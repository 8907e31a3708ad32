"""The panel's process runs before other programs, and gives that up while it is kept busy."""

from __future__ import annotations

import asyncio
import os
import resource
import signal
import subprocess
import sys
import threading
import time

import pytest

from contid_panel.priority import PAUSE_S, PRIORITY, before_clients

pytestmark = pytest.mark.process

#: Real time of the busy loop: several times `contid_panel.priority.BUSY_US`.
BUSY_S = 1.0


def policy() -> int:
    """Of this thread, without the flag for its children."""
    return os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK


async def panel() -> list[int]:
    """The policy at first, in a further thread, while busy, after the pause, and at the end."""
    found = []
    loop = asyncio.get_running_loop()
    with before_clients(loop):
        assert os.sched_getparam(0).sched_priority == PRIORITY
        found.append(policy())
        thread = threading.Thread(target=lambda: found.append(policy()))
        thread.start()
        thread.join()
        end_s = time.monotonic() + BUSY_S
        while policy() != os.SCHED_OTHER and time.monotonic() < end_s:
            await asyncio.sleep(0)
        found.append(policy())
        await asyncio.sleep(PAUSE_S + 1.0)
        found.append(policy())
    found.append(policy())
    assert resource.getrlimit(resource.RLIMIT_RTTIME)[0] == resource.RLIM_INFINITY
    assert signal.getsignal(signal.SIGXCPU) is signal.SIG_DFL
    return found


@pytest.mark.realtime
def test_a_busy_panel_runs_like_other_programs_for_a_while() -> None:
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(PRIORITY))
        os.sched_setscheduler(0, *before)
    except OSError as error:
        pytest.skip(f"SCHED_RR is not permitted: {error.strerror}")
    run = subprocess.run([sys.executable, __file__], capture_output=True, text=True, check=False)
    first, thread, *rest = os.SCHED_RR, os.SCHED_OTHER, os.SCHED_OTHER, os.SCHED_RR, os.SCHED_OTHER
    assert run.stdout.split() == [str(each) for each in (first, thread, *rest)], run.stderr


if __name__ == "__main__":
    print(*asyncio.run(panel()))
