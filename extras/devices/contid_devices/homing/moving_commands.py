"""What commands that move axes and write into the robot file have in common: ``home``, ``bringup``."""

from __future__ import annotations

import logging
import os
import signal
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

from contid.errors import ContidError
from contid_driverkit.signals import ENDING, handled_by

if TYPE_CHECKING:
    from contid.control.engine.wiring import WiredBus

log = logging.getLogger(__name__)


def require_axes(buses: Sequence[WiredBus], axes: Sequence[str]) -> None:
    """Raise `ContidError` for the first of ``axes`` (``ROBOT.AXIS``) that no bus carries."""
    existing = {axis.name for bus in buses for axis in bus.axes}
    if unknown := [name for name in axes if name not in existing]:
        raise ContidError(f"no axis {unknown[0]!r}; there are {', '.join(sorted(existing))}")


def require_writable(path: Path, verb: str) -> None:
    """Refuse to write into a robot file; ``verb`` is what to do with a copy.

    Raises:
        ContidError: it is a shipped one, found by its name, or it cannot be replaced.
    """
    from contid.robot_file.load import configs_folder

    if path.parent == configs_folder():
        raise ContidError(
            f"{path}: is shipped with contid and stays as it is; "
            f"`contid new NAME --from {path.stem}` makes a file of yours: {verb} that one"
        )
    if not os.access(path.resolve().parent, os.W_OK):
        raise ContidError(f"{path}: its folder is read-only; copy the file and {verb} the copy, or --dry-run")


@contextmanager
def interruptible() -> Iterator[None]:
    """The first Ctrl-C, SIGTERM or SIGHUP interrupts, devices relax; further ones change nothing.

    Meanwhile this process has the priority of the control process, where it may: a busy machine would else
    keep it from its devices for longer than their watchdogs wait, and every search would have to be repeated.
    """
    from contid.control.process.realtime import request_real_time

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        for number in ENDING:
            signal.signal(number, signal.SIG_IGN)
        raise KeyboardInterrupt

    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    refusal = request_real_time()
    if refusal:
        log.info(refusal)
    try:
        with handled_by(interrupt):
            yield
    finally:
        if not refusal:
            os.sched_setscheduler(0, policy, parameters)
