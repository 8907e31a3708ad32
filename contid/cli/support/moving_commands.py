"""What commands that move axes and write into the robot file have in common: ``home``, ``bringup``."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

from contid.errors import ContidError
from contid.kit.signals import ENDING, handled_by

if TYPE_CHECKING:
    from contid.control.engine.wiring import WiredBus


def require_axes(buses: Sequence[WiredBus], axes: Sequence[str]) -> None:
    """Raise `ContidError` for the first of ``axes`` (``ROBOT.AXIS``) that no bus carries."""
    existing = {axis.name for bus in buses for axis in bus.axes}
    if unknown := [name for name in axes if name not in existing]:
        raise ContidError(f"no axis {unknown[0]!r}; there are {', '.join(sorted(existing))}")


def require_writable(path: Path, verb: str) -> None:
    """Raise `ContidError` when a robot file cannot be replaced; ``verb`` is what to do with a copy."""
    if not os.access(path.resolve().parent, os.W_OK):
        raise ContidError(f"{path}: its folder is read-only; copy the file and {verb} the copy, or --dry-run")


@contextmanager
def interruptible() -> Iterator[None]:
    """The first Ctrl-C, SIGTERM or SIGHUP interrupts, devices relax; further ones change nothing."""

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        for number in ENDING:
            signal.signal(number, signal.SIG_IGN)
        raise KeyboardInterrupt

    with handled_by(interrupt):
        yield
