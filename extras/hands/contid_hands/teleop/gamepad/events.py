"""Events of Linux input devices: names and numbers of ``linux/input-event-codes.h``, bytes to events."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Final, NamedTuple

#: Types of events.
EV_SYN, EV_KEY, EV_REL, EV_ABS = 0, 1, 2, 3
SYN_REPORT, SYN_DROPPED = 0, 3
#: ``struct input_event``: seconds, microseconds, type, code, value.
EVENT: Final = struct.Struct("@llHHi")

_AXES: Final = ("X", "Y", "Z", "RX", "RY", "RZ")
_FURTHER: Final = ("THROTTLE", "RUDDER", "WHEEL", "GAS", "BRAKE")
ABSOLUTE: Final = {
    **{f"ABS_{name}": code for code, name in enumerate((*_AXES, *_FURTHER))},
    **{f"ABS_HAT{number // 2}{'XY'[number % 2]}": 0x10 + number for number in range(8)},
}  # fmt: skip
RELATIVE: Final = {f"REL_{name}": code for code, name in enumerate(_AXES)}
_JOYSTICK: Final = ("TRIGGER", "THUMB", "THUMB2", "TOP", "TOP2", "PINKIE", "BASE", "BASE2", "BASE3", "BASE4",
                    "BASE5", "BASE6")  # fmt: skip
_GAMEPAD: Final = ("SOUTH", "EAST", "C", "NORTH", "WEST", "Z", "TL", "TR", "TL2", "TR2", "SELECT", "START",
                   "MODE", "THUMBL", "THUMBR")  # fmt: skip
_DPAD: Final = ("DPAD_UP", "DPAD_DOWN", "DPAD_LEFT", "DPAD_RIGHT")
BUTTONS: Final = {
    **{f"BTN_{number}": 0x100 + number for number in range(10)},
    **{f"BTN_{name}": 0x120 + number for number, name in enumerate(_JOYSTICK)},
    **{f"BTN_{name}": 0x130 + number for number, name in enumerate(_GAMEPAD)},
    **{f"BTN_{name}": 0x220 + number for number, name in enumerate(_DPAD)},
}


class InputEvent(NamedTuple):
    """One event of a device, without its time."""

    type: int
    code: int
    value: int


class EventDecoder:
    """Bytes of a device to events, however they are cut."""

    def __init__(self) -> None:
        self._pending = b""

    def feed(self, data: bytes) -> Iterator[InputEvent]:
        """Events of further bytes."""
        data = self._pending + data
        whole = len(data) - len(data) % EVENT.size
        self._pending = data[whole:]
        for _, _, kind, code, value in EVENT.iter_unpack(data[:whole]):
            yield InputEvent(kind, code, value)
