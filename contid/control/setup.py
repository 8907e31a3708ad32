"""What the control process is given before it starts, and what of the machine it asks for."""

from __future__ import annotations

import gc
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from contid.control.cycle import OnEnd
from contid.description.load import LoadedFile
from contid.trajectory.approach import Approach
from contid.trajectory.timed import Trajectory

PRIORITY: Final = 50
#: Sleep this much short of the deadline and spin the rest: a sleeper wakes up to some 100 us late.
SPIN_S: Final = 250e-6


@dataclass(frozen=True, slots=True)
class Setup:
    """The first message on the pipe.

    Attributes:
        loaded: the robot file, checked already.
        rate_hz: of the tick.
        ring: path of the ring to write.
        trajectory: timed rows to follow, or None.
        on_end: what to do at its end.
        attended: orders may come: do not end because every robot is in FAULT.
        armed: arm at once; False to connect and wait for `resume`.
    """

    loaded: LoadedFile
    rate_hz: float
    ring: Path
    trajectory: Trajectory | None
    on_end: OnEnd
    attended: bool
    armed: bool = True


def ask_for_real_time() -> str:
    """Run under SCHED_FIFO; returns why not, or "" when it worked."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError as error:
        return (
            f"SCHED_FIFO not permitted ({error.strerror}): ticks may be late when the machine is busy; "
            "run as root, or give CAP_SYS_NICE or LimitRTPRIO"
        )
    return ""


def warm_up() -> None:
    """Import what the first approach needs, and solve one, before a tick has to."""
    Approach((0.0,), (0.0,), (1.0,), 1.0, 1.0, 1.0).at(0.5)


def stop_collecting() -> None:
    """No garbage collection during ticks: what exists stays, what a tick makes is freed by counting."""
    gc.collect()
    gc.freeze()
    gc.disable()


def sleep_until(deadline_s: float, now: Callable[[], float] = time.monotonic) -> float:
    """Wait for a deadline on the monotonic clock; returns the time it is then."""
    rest_s = deadline_s - now() - SPIN_S
    if rest_s > 0.0:
        time.sleep(rest_s)
    while (now_s := now()) < deadline_s:
        pass
    return now_s
