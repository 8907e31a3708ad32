"""Serial ports: found by path, glob or USB identity, and the processes that have them open."""

from __future__ import annotations

import contextlib
import glob
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from serial.tools import list_ports

from contid.errors import DeviceNotFoundError


@dataclass(frozen=True, slots=True)
class UsbIdentity:
    """Identity of an adapter, the same under every device name."""

    vid: int | None
    pid: int | None
    serial_number: str


#: Names of serial ports that stay: ``by-id`` those of adapters, ``by-path`` those of sockets.
SERIAL: Final = Path("/dev/serial")
#: USB vendors of Arduino boards (arduino.cc, arduino.org). Opening the port of most of them resets the board.
ARDUINO_VENDORS: Final = (0x2341, 0x2A03)
#: USB products of an Arduino Due: its programming port, which a reset follows, and its native port.
DUE_PROGRAMMING: Final = 0x003D
DUE_NATIVE: Final = 0x003E
#: USB vendor and product of a Teensy with a serial port.
TEENSY: Final = (0x16C0, 0x0483)


@dataclass(frozen=True, slots=True)
class UsbPort:
    """A USB serial port: device path (by-id where there is one), vendor and product."""

    path: str
    vid: int
    pid: int

    @property
    def arduino(self) -> bool:
        """Whether it belongs to an Arduino board, or a Teensy."""
        return self.vid in ARDUINO_VENDORS or self.teensy

    @property
    def teensy(self) -> bool:
        """Whether it belongs to a Teensy."""
        return (self.vid, self.pid) == TEENSY

    @property
    def due(self) -> bool:
        """Whether it is one of the two ports of an Arduino Due."""
        return self.vid in ARDUINO_VENDORS and self.pid in (DUE_PROGRAMMING, DUE_NATIVE)

    @property
    def native(self) -> bool:
        """Whether it is the native port of a board that the sketch runs on; opening it resets nothing."""
        return self.teensy or (self.due and self.pid == DUE_NATIVE)


def usb_ports() -> list[UsbPort]:
    """USB serial ports of this machine."""
    stable = {str(path.resolve()): str(path) for path in sorted((SERIAL / "by-id").glob("*"))}
    return [
        UsbPort(stable.get(port.device, port.device), port.vid, port.pid or 0)
        for port in list_ports.comports()
        if port.vid is not None
    ]


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
        *(str(p) for p in sorted((SERIAL / "by-id").glob("*"))),
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
