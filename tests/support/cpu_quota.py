"""A cgroup of its own with a share of a processor, for processes that are to starve; cgroups v1 and v2."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

ROOT: Final = Path("/sys/fs/cgroup")
PERIOD_US: Final = 100_000


def _parent() -> Path:
    """The folder of this process in the hierarchy that has the cpu controller."""
    for line in Path("/proc/self/cgroup").read_text().splitlines():
        _, controllers, path = line.split(":", 2)
        if "cpu" in controllers.split(","):
            mounts = [ROOT / controllers, ROOT / "cpu"]
            return next((each for each in mounts if each.is_dir()), mounts[-1]) / path.lstrip("/")
    path = Path("/proc/self/cgroup").read_text().splitlines()[-1].split(":", 2)[2]
    return ROOT / path.lstrip("/")


def obstacle() -> str:
    """Why this user cannot give processes a quota; empty if it can."""
    try:
        with quota((), 0.5):
            return ""
    except OSError as error:
        return f"no cgroup with a quota of processor time can be made ({error})"


@contextmanager
def quota(processes: Iterable[int], share: float) -> Iterator[None]:
    """Processes get at most a share of one processor; they leave the cgroup, which is removed, at the end.

    Args:
        processes: ids; without real-time policy, which the kernel may refuse in such a cgroup.
        share: of one processor, 0.01 or more.

    Raises:
        OSError: not permitted, or no such controller here.
    """
    parent = _parent()
    folder = parent / f"contid-{os.getpid()}"
    folder.mkdir()
    try:
        most_us = int(share * PERIOD_US)
        if (folder / "cpu.max").exists():
            (folder / "cpu.max").write_text(f"{most_us} {PERIOD_US}")
        else:
            (folder / "cpu.cfs_period_us").write_text(str(PERIOD_US))
            (folder / "cpu.cfs_quota_us").write_text(str(most_us))
        for process in processes:
            (folder / "cgroup.procs").write_text(str(process))
        yield
    finally:
        for left in (folder / "cgroup.procs").read_text().split():
            (parent / "cgroup.procs").write_text(left)
        folder.rmdir()
