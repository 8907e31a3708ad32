"""The panel's priority: STOP passes through it, so a busy computer must not delay it.

A nice value is not enough. Where the kernel groups processes by session (sched(7), autogroup) or by service,
nice values act within a group only, and the panel waited 60 to 140 ms while the processes of a browser drew
on both cores. Under SCHED_RR at the lowest priority it runs before all of these, and after the control
process. A panel that is kept busy gives that up, so that the daemon's other processes keep their share.
"""

from __future__ import annotations

import asyncio
import os
import resource
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

#: Under SCHED_RR; the control process has 50 under SCHED_FIFO.
PRIORITY: Final = 1
#: Processor time without a pause after which the panel runs like other programs [us], and for how long [s].
BUSY_US: Final = 200_000
PAUSE_S: Final = 2.0


@contextmanager
def before_clients(loop: asyncio.AbstractEventLoop) -> Iterator[None]:
    """Run this thread under SCHED_RR where that is permitted; its children and further threads do not.

    Args:
        loop: of this thread, which is the main thread.
    """
    if not _schedule(os.SCHED_RR, PRIORITY):
        yield
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_RTTIME)

    def busy() -> None:
        _schedule(os.SCHED_OTHER, 0)
        loop.call_later(PAUSE_S, _schedule, os.SCHED_RR, PRIORITY)

    loop.add_signal_handler(signal.SIGXCPU, busy)
    limit_us = BUSY_US if hard == resource.RLIM_INFINITY else min(BUSY_US, hard)
    resource.setrlimit(resource.RLIMIT_RTTIME, (limit_us, hard))
    try:
        yield
    finally:
        _schedule(os.SCHED_OTHER, 0)
        resource.setrlimit(resource.RLIMIT_RTTIME, (soft, hard))
        loop.remove_signal_handler(signal.SIGXCPU)


def _schedule(policy: int, priority: int) -> bool:
    """Set the policy; False when it is not permitted."""
    try:
        os.sched_setscheduler(0, policy | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except OSError:
        return False
    return True
