"""Real-time settings of the control process: priority, warm-up, garbage collection, precise sleep."""

from __future__ import annotations

import gc
import os
import time
from collections.abc import Callable
from typing import Final

from contid.trajectory.approach import Approach

#: Priority under SCHED_FIFO.
PRIORITY: Final = 50
EMULATED: Final = 40
TRACKER: Final = 30
#: Sleep ends this long before the deadline and spinning follows: wake-ups are up to 100 us late.
SPIN_S: Final = 250e-6


def request_real_time(priority: int = PRIORITY) -> str:
    """Run under SCHED_FIFO; returns why not, or "" when it worked.

    Processes around the control process take less than `PRIORITY`: emulated devices `EMULATED`, trackers
    `TRACKER`. A busy machine would else silence devices, and make tips old, by tens of milliseconds.
    """
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except OSError as error:
        return (
            f"SCHED_FIFO not permitted ({error.strerror}): ticks may be late when the machine is busy; "
            "run as root, or give CAP_SYS_NICE or LimitRTPRIO"
        )
    return ""


def warm_up() -> None:
    """Import and run the approach once, before the first tick needs it."""
    Approach((0.0,), (0.0,), (1.0,), (1.0,), (1.0,), (1.0,)).at(0.5)


def disable_gc() -> None:
    """Disable cyclic garbage collection; reference counting frees what a tick allocates."""
    gc.collect()
    gc.freeze()
    gc.disable()


def sleep_until(deadline_s: float, now: Callable[[], float] = time.monotonic) -> float:
    """Wait for a deadline on the monotonic clock; returns the time after waiting."""
    rest_s = deadline_s - now() - SPIN_S
    if rest_s > 0.0:
        time.sleep(rest_s)
    while (now_s := now()) < deadline_s:
        pass
    return now_s
