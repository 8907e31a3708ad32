"""The gamepad or 3D mouse of this machine."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from contid.errors import ContidError
from contid_hands.teleop.gamepad.device import InputDevice, open_device

FOLDER: Final = Path("/dev/input")


def find_device(folder: Path = FOLDER) -> InputDevice:
    """The only gamepad or 3D mouse.

    Raises:
        ContidError: there is none, or there are several; with what was found.
    """
    found: list[InputDevice] = []
    others: list[str] = []
    for path in sorted(folder.glob("event*"), key=lambda path: (len(path.name), path.name)):
        try:
            device = open_device(path)
        except ContidError as error:
            others.append(f"  {error}")
            continue
        if device.has.kind is None:
            others.append(f"  {path}: {device.has.name}")
            _close([device])
        else:
            found.append(device)
    if len(found) == 1:
        return found[0]
    _close(found)
    if found:
        listed = "\n".join(f"  {each.path}: {each.has.name} ({each.has.kind})" for each in found)
        raise ContidError(f"there are several gamepads; name one, --gamepad {found[0].path}:\n{listed}")
    listed = "\n".join(others) if others else f"  no device in {folder}"
    raise ContidError(f"no gamepad or 3D mouse was found among:\n{listed}")


def choose_device(name: str) -> InputDevice:
    """The device of a path, or the only one for "".

    Raises:
        ContidError: there is none, several, or it cannot be read.
    """
    if name and "/" not in name and not Path(name).exists():
        raise ContidError(
            f"{name}: is no path of a device; write the robot first: contid jog {name} --gamepad [DEVICE]"
        )
    return open_device(name) if name else find_device()


def _close(devices: list[InputDevice]) -> None:
    for device in devices:
        with device:
            pass
