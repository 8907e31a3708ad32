"""Boards with the sketch on native USB ports, by their hello. Opening a native port resets nothing."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from contid.errors import ContidError
from contid.hal import FoundDevice, Report
from contid_drivers.due.options import DueBusOptions, Role
from contid_drivers.due.session import ask_hello
from contid_drivers.serial_ports import usb_ports

#: A board answers within milliseconds; one that starts at the same moment within this time.
_HELLO_MS: Final = 500.0
#: Folder of pseudo-terminals: emulated boards, when named.
_PTYS: Final = Path("/dev/pts")


def scan(ports: Sequence[str], report: Report) -> list[FoundDevice]:
    """Boards that answer a hello; nothing else is sent, and no programming port is opened.

    Args:
        ports: empty for every native port; a named port counts when it is one, or a pseudo-terminal.
        report: takes lines about ports that do not answer.
    """
    usb = {Path(port.path).resolve(): port for port in usb_ports()}
    native = {real: port.path for real, port in usb.items() if port.native}
    given = {path: Path(path).resolve() for path in ports} or {path: real for real, path in native.items()}
    found = []
    for path, real in given.items():
        if real not in native and (real in usb or real.parent != _PTYS):
            continue
        try:
            # The role is that of the answer; hello asks for none.
            hello = ask_hello(path, DueBusOptions(port=path, role=Role.MOTOR, hello_ms=_HELLO_MS))
        except ContidError as error:
            report(str(error))
            continue
        version = ".".join(map(str, hello.firmware))
        board = "Teensy" if real in usb and usb[real].teensy else "Arduino Due"
        found.append(FoundDevice(path, 0, hello.unique_id, f"{board}, {hello.role_name} board", version))
    return found
