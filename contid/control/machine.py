"""What `contid doctor` says about the machine itself: real time, shared memory, service, udev rules."""

from __future__ import annotations

import os
import resource
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from contid.control.ring import folder
from contid.control.setup import PRIORITY
from contid.hal import Finding

UNIT: Final = "contid@.service"
RULES: Final = "99-contid.rules"
UNIT_FOLDERS: Final = ("/etc/systemd/system", "/usr/local/lib/systemd/system", "/usr/lib/systemd/system")
RULES_FOLDERS: Final = ("/etc/udev/rules.d", "/usr/local/lib/udev/rules.d", "/usr/lib/udev/rules.d")
#: A ring takes a few MB; below this, the next one may not fit.
ENOUGH_BYTES: Final = 64 << 20
#: Without these a unit is none of ours, or was edited into something that may move by itself.
UNIT_MUST_SAY: Final = ("Type=notify", "WatchdogSec=", "LimitRTPRIO=", "--disarmed")


def examine(root: Path = Path("/")) -> list[Finding]:
    """Every finding about this machine; advice counts as well, with its remedy.

    Args:
        root: where the folders of units and rules are looked for.
    """
    return [real_time(), shared_memory(), unit(root), rules(root)]


def real_time() -> Finding:
    """Whether the control process may run under SCHED_FIFO."""
    before, parameter = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError as error:
        limit = resource.getrlimit(resource.RLIMIT_RTPRIO)[0]
        why = f"{error.strerror}; LimitRTPRIO {limit}"
        words = f"SCHED_FIFO is not permitted ({why}): ticks may be late under load"
        remedy = (
            f"@dialout - rtprio {PRIORITY} in /etc/security/limits.d/contid.conf, or LimitRTPRIO={PRIORITY}"
        )
        return Finding("real time", True, words, remedy)
    os.sched_setscheduler(0, before, parameter)
    return Finding("real time", True, f"SCHED_FIFO at priority {PRIORITY} is permitted")


def shared_memory() -> Finding:
    """Whether the ring has a place."""
    place = folder()
    if not os.access(place, os.W_OK):
        return Finding("shared memory", False, f"{place} cannot be written", f"mount a tmpfs at {place}")
    free = shutil.disk_usage(place).free
    if free < ENOUGH_BYTES:
        words = f"{place} has {free >> 20} MB left, {ENOUGH_BYTES >> 20} MB are wanted"
        return Finding(
            "shared memory", False, words, f"remove files from {place}, or give it more (--shm-size)"
        )
    return Finding("shared memory", True, f"{place} has {free >> 20} MB left")


def unit(root: Path) -> Finding:
    """Whether the service is installed, and still one that never arms by itself."""
    path = _first(root, UNIT_FOLDERS, UNIT)
    if path is None:
        words = f"{UNIT} is not installed; needed only for robots that run without a person logged in"
        return Finding("service", True, words, f"docs/service.md; copy service/{UNIT} to {UNIT_FOLDERS[0]}")
    text = "\n".join(
        part.read_text(errors="replace") for part in [path, *sorted(Path(f"{path}.d").glob("*.conf"))]
    )
    missing = [words for words in UNIT_MUST_SAY if words not in text]
    if missing:
        words = f"{path} lacks {', '.join(missing)}"
        return Finding("service", False, words, f"compare it with service/{UNIT} of this version")
    return Finding("service", True, f"{path}")


def rules(root: Path) -> Finding:
    """Whether the udev rules are installed."""
    path = _first(root, RULES_FOLDERS, RULES)
    if path is None:
        words = (
            f"{RULES} is not installed: serial ports may need root, and FTDI adapters delay answers by 16 ms"
        )
        return Finding(
            "udev rules", True, words, f"sudo cp udev/{RULES} {RULES_FOLDERS[0]}/; docs/service.md"
        )
    return Finding("udev rules", True, f"{path}")


def _first(root: Path, folders: Sequence[str], name: str) -> Path | None:
    for each in folders:
        path = root / each.lstrip("/") / name
        if path.is_file():
            return path
    return None
