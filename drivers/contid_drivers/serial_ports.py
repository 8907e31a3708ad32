"""Serial ports: found by path, glob or USB identity, and the processes that have them open."""

from __future__ import annotations

import contextlib
import glob
import os
from dataclasses import dataclass
from pathlib import Path

from serial.tools import list_ports

from contid.errors import DeviceNotFoundError


@dataclass(frozen=True, slots=True)
class UsbIdentity:
    """Identity of an adapter, the same under every device name."""

    vid: int | None
    pid: int | None
    serial_number: str


def identity_of(path: str) -> UsbIdentity | None:
    """USB identity of the adapter behind a device path; None without a serial number."""
    real = str(Path(path).resolve())
    for port in list_ports.comports():
        if port.device == real and port.serial_number:
            return UsbIdentity(port.vid, port.pid, port.serial_number)
    return None


def find_port(bus: str, pattern: str, adapter: UsbIdentity | None = None) -> str:
    """Device path for the ``port`` of a robot file.

    Args:
        bus: its name, for messages.
        pattern: a path (``~`` allowed) or a glob.
        adapter: searched for under another name when the pattern matches nothing.

    Raises:
        DeviceNotFoundError: no match or several; lists the ports present.
    """
    pattern = str(Path(pattern).expanduser())
    found = sorted(glob.glob(pattern))  # noqa: PTH207  # an absolute pattern has no Path to start from
    if not found and adapter is not None:
        found = sorted(
            port.device
            for port in list_ports.comports()
            if UsbIdentity(port.vid, port.pid, port.serial_number or "") == adapter
        )
    if len(found) == 1:
        return found[0]
    if found:
        raise DeviceNotFoundError(
            bus,
            f"port {pattern} matches {', '.join(found)}",
            "name one of them, preferably by its /dev/serial/by-id path",
        )
    present = [
        *(str(p) for p in sorted(Path("/dev/serial/by-id").glob("*"))),
        *(p.device for p in list_ports.comports()),
    ]
    raise DeviceNotFoundError(
        bus,
        f"no port {pattern}; serial ports present: {', '.join(present) or 'none'}",
        "plug the adapter in, or run `contid scan`",
    )


def holders(path: str) -> list[str]:
    """Other processes of this user that have a device open: ``pid NUMBER NAME``."""
    real = str(Path(path).resolve())
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        if process.name == str(os.getpid()):
            continue
        with contextlib.suppress(OSError):
            if any(str(fd.readlink()) == real for fd in (process / "fd").iterdir()):
                found.append(f"pid {process.name} {(process / 'comm').read_text().strip()}")
    return found
