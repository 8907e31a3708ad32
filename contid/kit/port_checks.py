"""What ``contid doctor`` finds about a serial port before a device is asked: name, rights, latency, owner."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

from contid.hal import Finding
from contid.kit.serial_ports import holders, port_name

#: Where the kernel describes serial ports.
TTYS: Final = Path("/sys/class/tty")


def port_findings(bus: str, pattern: str, path: str, udev: str) -> list[Finding]:
    """Findings about the port of a bus.

    Args:
        bus: its name.
        pattern: the ``port`` of the robot file.
        path: the port found.
        udev: the remedy for missing rights and slow adapters.
    """
    return [*port_name(bus, pattern, path), _permission(bus, path, udev), latency_timer(bus, path, udev)]


def _permission(bus: str, path: str, udev: str) -> Finding:
    good = os.access(path, os.R_OK | os.W_OK)
    return Finding(
        f"{bus} permission",
        good,
        f"{path} is {'readable and writable' if good else 'not accessible to this user'}",
        "" if good else udev,
    )


def latency_timer(bus: str, path: str, udev: str) -> Finding:
    """How long the adapter keeps received bytes back; adapters of FTDI do for 16 ms unless set otherwise."""
    timer = TTYS / Path(path).resolve().name / "device" / "latency_timer"
    subject = f"{bus} latency timer"
    try:
        value = int(timer.read_text())
    except (OSError, ValueError):
        return Finding(subject, True, "none on this adapter")
    remedy = "" if value <= 1 else f"{udev}; now: echo 1 | sudo tee {timer}"
    return Finding(subject, value <= 1, f"{value} ms of delay per read; 1 is right", remedy)


def owner(bus: str, path: str) -> Finding:
    """Other processes that have the port open as well, once it is open and locked."""
    others = holders(path)
    text = f"locked for contid; also open in {', '.join(others)}" if others else "no other process"
    return Finding(f"{bus} owner", True, text)
