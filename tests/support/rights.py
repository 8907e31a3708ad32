"""What this user may do."""

from __future__ import annotations

import os


def real_time_permitted() -> bool:
    """Whether a process may have real-time priority: root, CAP_SYS_NICE or LimitRTPRIO."""
    child = os.fork()
    if child == 0:
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
        except OSError:
            os._exit(1)
        os._exit(0)
    return os.waitpid(child, 0)[1] == 0
