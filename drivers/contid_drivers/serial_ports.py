"""Serial ports by what a robot file says of them, and who holds them."""

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
    """What stays the same when an adapter is plugged in again under another name."""

    vid: int | None
    pid: int | None
    serial_number: str


def identity_of(path: str) -> UsbIdentity | None:
    """USB identity of the adapter behind a device path, None for anything without a serial number."""
    real = str(Path(path).resolve())
    for port in list_ports.comports():
        if port.device == real and port.serial_number:
            return UsbIdentity(port.vid, port.pid, port.serial_number)
    return None


def find_port(bus: str, wanted: str, known: UsbIdentity | None = None) -> str:
    """Device path for the ``port`` of a robot file.

    Args:
        bus: its name, for messages.
        wanted: a path (``~`` allowed) or a glob.
        known: the adapter that was there before; it is found again under another name.

    Raises:
        DeviceNotFoundError: nothing or more than one device fits; lists what there is.
    """
    wanted = str(Path(wanted).expanduser())
    found = sorted(glob.glob(wanted))  # noqa: PTH207  # an absolute pattern has no Path to start from
    if not found and known is not None:
        found = sorted(
            port.device
            for port in list_ports.comports()
            if (port.vid, port.pid, port.serial_number) == (known.vid, known.pid, known.serial_number)
        )
    if len(found) == 1:
        return found[0]
    if found:
        raise DeviceNotFoundError(
            bus,
            f"port {wanted} fits {', '.join(found)}",
            "name one of them, best by its /dev/serial/by-id path",
        )
    present = [
        *(str(p) for p in sorted(Path("/dev/serial/by-id").glob("*"))),
        *(p.device for p in list_ports.comports()),
    ]
    raise DeviceNotFoundError(
        bus,
        f"there is no port {wanted}; serial ports here: {', '.join(present) or 'none'}",
        "plug the adapter in, or run `contid scan`",
    )


def holders(path: str) -> list[str]:
    """Processes of this user that have a device open: ``pid NAME``."""
    real = str(Path(path).resolve())
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        if process.name == str(os.getpid()):
            continue
        with contextlib.suppress(OSError):
            if any(str(fd.readlink()) == real for fd in (process / "fd").iterdir()):
                found.append(f"pid {process.name} {(process / 'comm').read_text().strip()}")
    return found
