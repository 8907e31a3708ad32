"""Keeps an event loop that stops pass through prompt: short garbage collections, a priority above clients.

A collection visits every container that it may free: with the imported modules among them it held the loop
for 40 to 60 ms, which a stop waited for. Frozen, they are not visited.

Where the kernel groups processes by session (sched(7), autogroup), a nice value acts within the session only.
In a session of its own (a service, `setsid`) the daemon sets the group's value too; in a terminal it would
raise the shell and whatever else runs there.
"""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

#: Nice value, as of the recorder: on a busy machine the clients that flood the daemon do not delay it.
NICE: Final = -10
_AUTOGROUP: Final = Path("/proc/self/autogroup")


@contextmanager
def responsive(nice: int = NICE, with_group: bool = True) -> Iterator[None]:
    """Hold what was imported out of garbage collections; run at a nice value where that is permitted.

    Enter it before the first robot moves: it collects once. Processes that start inside inherit the
    nice value.

    Args:
        nice: of this process; a lower one stays.
        with_group: in a session of its own the group gets it too.
    """
    gc.collect()
    gc.freeze()
    before = os.getpriority(os.PRIO_PROCESS, 0)
    group = _group_nice() if with_group and os.getsid(0) == os.getpid() else None
    _set(min(before, nice), None if group is None else min(group, nice))
    try:
        yield
    finally:
        _set(before, group)
        gc.unfreeze()


def _group_nice() -> int:
    """The nice value of the session's group; 0 where the kernel has no groups."""
    try:
        return int(_AUTOGROUP.read_text().rpartition(" ")[2])  # /autogroup-7097 nice 0
    except (OSError, ValueError):
        return 0


def _set(nice: int, group: int | None) -> None:
    """Set both, where permitted (CAP_SYS_NICE, LimitNICE); None leaves the group alone."""
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, nice)
    with suppress(OSError):
        if group is not None and _group_nice() != group:
            _AUTOGROUP.write_text(str(group))
