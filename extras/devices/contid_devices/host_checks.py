"""Host checks of `contid doctor`: real time, shared memory, service, udev rules."""

from __future__ import annotations

import grp
import os
import resource
import shutil
from pathlib import Path
from typing import Final

from contid.control.process.realtime import PRIORITY
from contid.control.process.shared_files import folder
from contid.hal import Finding
from contid_devices.host_files import (
    RULES,
    RULES_FOLDERS,
    UNIT,
    UNIT_FOLDERS,
    installed,
    shipped_text,
)

FIX: Final = "sudo $(command -v contid) doctor ROBOT.yaml --fix"
#: A ring takes a few MB; below this the next one may not fit.
ENOUGH_BYTES: Final = 64 << 20
#: Where ModemManager is installed, by distribution.
MODEM_MANAGER: Final = ("usr/sbin/ModemManager", "usr/bin/ModemManager")
#: CH340 and CP210x as brltty before 6.5 has them, vendor and product (arduino/arduino-ide, issue 1788).
BRLTTY_TAKES: Final = ("1a86/7523", "10c4/ea60")
#: Required in the unit; without ``--disarmed`` robots could move when the service starts.
UNIT_REQUIRES: Final = ("Type=notify", "WatchdogSec=", "LimitRTPRIO=", "ExecStart=/", "--disarmed")


def examine(root: Path = Path("/")) -> list[Finding]:
    """All findings about this machine.

    Args:
        root: root of the folders of units and rules.
    """
    return [real_time(), shared_memory(), unit(root), *clients(root), rules(root), *port_takers(root)]


def real_time() -> Finding:
    """Whether the control process may run under SCHED_FIFO."""
    before, parameter = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError as error:
        limit = resource.getrlimit(resource.RLIMIT_RTPRIO)[0]
        why = f"{error.strerror}; LimitRTPRIO {limit}"
        message = (
            f"SCHED_FIFO is not permitted ({why}): under load ticks are late, devices may stop (fault 108)"
        )
        return Finding("real time", True, message, f"{FIX}; in a unit LimitRTPRIO={PRIORITY}", warning=True)
    os.sched_setscheduler(0, before, parameter)
    return Finding("real time", True, f"SCHED_FIFO at priority {PRIORITY} is permitted")


def shared_memory() -> Finding:
    """Whether the ring fits into shared memory."""
    path = folder()
    if not os.access(path, os.W_OK):
        return Finding("shared memory", False, f"{path} cannot be written", f"mount a tmpfs at {path}")
    free = shutil.disk_usage(path).free
    if free < ENOUGH_BYTES:
        message = f"{path} has {free >> 20} MB left, {ENOUGH_BYTES >> 20} MB are needed"
        return Finding(
            "shared memory", False, message, f"remove files from {path}, or enlarge it (--shm-size)"
        )
    return Finding("shared memory", True, f"{path} has {free >> 20} MB left")


def unit(root: Path) -> Finding:
    """Whether the service is installed and never arms on its own."""
    path = installed(root, UNIT_FOLDERS, UNIT)
    if path is None:
        message = f"{UNIT} is not installed; needed only for robots that run without a logged-in user"
        return Finding("service", True, message, "docs/service.md; contid doctor ROBOT.yaml --fix --service")
    text = _with_drop_ins(root, path)
    missing = [line for line in UNIT_REQUIRES if line not in text]
    if missing:
        message = f"{path} lacks {', '.join(missing)}"
        return Finding("service", False, message, f"compare it with host/{UNIT} of this version")
    program = Path(_command(text)[0])
    if not os.access(root / program.relative_to("/"), os.X_OK):
        message = f"{path} starts {program}, which does not exist or is not executable"
        remedy = f"ln -s $(command -v contid) {program}, or `systemctl edit` with the right ExecStart"
        return Finding("service", False, message, remedy)
    return Finding("service", True, f"{path}")


def clients(root: Path) -> list[Finding]:
    """Who may command the service, and whether this user may; empty when it is not installed."""
    path = installed(root, UNIT_FOLDERS, UNIT)
    if path is None:
        return []
    command = _command(_with_drop_ins(root, path))
    if "--socket-group" not in command[:-1]:
        return [Finding("service clients", True, "the service's own user and root")]
    name = command[command.index("--socket-group") + 1]
    try:
        members = grp.getgrnam(name)
    except KeyError:
        message = f"the unit admits group {name}, which does not exist"
        return [Finding("service clients", False, message, f"sudo groupadd --system {name}")]
    if os.geteuid() == 0 or members.gr_gid in (os.getegid(), *os.getgroups()):
        return [Finding("service clients", True, f"members of group {name}, including you")]
    message = f"members of group {name}; you are not one: `contid status` will not reach the service"
    return [
        Finding(
            "service clients", True, message, f"sudo usermod --append --groups {name} $USER; log in again"
        )
    ]


def _with_drop_ins(root: Path, path: Path) -> str:
    """The text of a unit and its drop-ins, which may be in another folder (systemd.unit(5))."""
    folders = [root / each.lstrip("/") / f"{UNIT}.d" for each in UNIT_FOLDERS]
    found = (part for folder in folders for part in folder.glob("*.conf"))
    parts = [path, *sorted(found, key=lambda part: part.name)]
    return "\n".join(part.read_text(errors="replace") for part in parts)


def _command(text: str) -> list[str]:
    """The arguments of the last ExecStart: a drop-in overrides the unit."""
    lines = [line for line in text.splitlines() if line.startswith("ExecStart=/")]
    return lines[-1].removeprefix("ExecStart=").split() if lines else ["/"]


def rules(root: Path) -> Finding:
    """Whether the udev rules are installed."""
    path = installed(root, RULES_FOLDERS, RULES)
    if path is None:
        message = (
            f"{RULES} is not installed: serial ports may need root, and FTDI adapters add 16 ms of latency"
        )
        return Finding("udev rules", True, message, FIX)
    if path.read_text(errors="replace") != shipped_text(RULES):
        return Finding("udev rules", True, f"{path} is not that of this version", FIX, warning=True)
    return Finding("udev rules", True, f"{path}")


def port_takers(root: Path) -> list[Finding]:
    """Programs of this machine that open serial adapters on their own; empty for none."""
    found = []
    if _brltty_takes_adapters(root):
        message = "its udev rules take CP210x and CH34x adapters: the port vanishes soon after plugging in"
        remedy = (
            "without a braille display: sudo apt remove brltty; with one on another port: "
            "sudo ln -s /dev/null /etc/udev/rules.d/85-brltty.rules, or brltty 6.5"
        )
        found.append(Finding("brltty", True, message, remedy, warning=True))
    if any((root / path).exists() for path in MODEM_MANAGER):
        ignored = installed(root, RULES_FOLDERS, RULES) is not None
        message = "it opens new serial ports and writes to them" + (
            "; the udev rules of contid keep it from its adapters" if ignored else ""
        )
        remedy = "" if ignored else FIX
        found.append(Finding("ModemManager", True, message, remedy, warning=not ignored))
    return found


def _brltty_takes_adapters(root: Path) -> bool:
    """Whether an active rule of brltty names a common adapter; one of /etc hides one of the same name."""
    rules: dict[str, Path] = {}
    for each in reversed(RULES_FOLDERS):
        rules |= {path.name: path for path in (root / each.lstrip("/")).glob("*brltty*.rules")}
    text = "\n".join(path.read_text(errors="replace") for path in rules.values())
    active = [line for line in text.splitlines() if not line.lstrip().startswith("#")]
    return any(adapter in line.lower() for line in active for adapter in BRLTTY_TAKES)
