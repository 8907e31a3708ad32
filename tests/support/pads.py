"""Event streams of gamepads through a pipe: the bytes of the kernel's ``struct input_event``."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Iterator
from contextlib import contextmanager

from contid_hands.teleop.gamepad.device import AbsInfo, Capabilities, InputDevice

SYN, KEY, REL, ABS = 0, 1, 2, 3
#: linux/input-event-codes.h.
BTN_SOUTH, BTN_EAST, BTN_TL, BTN_START, BTN_SELECT = 0x130, 0x131, 0x136, 0x13B, 0x13A
ABS_X, ABS_Y, ABS_RX, ABS_RY = 0, 1, 3, 4
#: An Xbox pad under the driver xpad: ranges, noise and dead zone as EVIOCGABS gives them.
STICK = AbsInfo(0, -32768, 32767, 16, 128)
XBOX = Capabilities(
    name="Microsoft X-Box 360 pad",
    vendor=0x045E,
    keys=frozenset({*range(0x130, 0x13F)} - {0x132, 0x135, 0x138, 0x139}),
    relative=frozenset(),
    absolute={0: STICK, 1: STICK, 2: AbsInfo(0, 0, 255), 3: STICK, 4: STICK, 5: AbsInfo(0, 0, 255),
              16: AbsInfo(0, -1, 1), 17: AbsInfo(0, -1, 1)},
)  # fmt: skip
SPACENAVIGATOR = Capabilities(
    name="3Dconnexion SpaceNavigator",
    vendor=0x046D,
    keys=frozenset({0x100, 0x101}),
    relative=frozenset(range(6)),
    absolute={},
)


class KernelEvent(ctypes.Structure):
    """linux/input.h: a struct timeval, two __u16, an __s32."""

    _fields_ = (("seconds", ctypes.c_long), ("microseconds", ctypes.c_long), ("type", ctypes.c_uint16),
                ("code", ctypes.c_uint16), ("value", ctypes.c_int32))  # fmt: skip


def event(kind: int, code: int, value: int) -> bytes:
    return bytes(KernelEvent(1_790_000_000, 123_456, kind, code, value))


REPORT = event(SYN, 0, 0)
DROPPED = event(SYN, 3, 0)


class Recording:
    """The end of the pipe that the kernel has."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self.open = True

    def write(self, data: bytes) -> None:
        os.write(self._descriptor, data)

    def button(self, code: int, value: int) -> None:
        self.write(event(KEY, code, value) + REPORT)

    def axis(self, code: int, value: int, kind: int = ABS) -> None:
        self.write(event(kind, code, value) + REPORT)

    def unplug(self) -> None:
        if self.open:
            os.close(self._descriptor)
        self.open = False


@contextmanager
def recorded(has: Capabilities = XBOX) -> Iterator[tuple[Recording, InputDevice]]:
    """A device on a pipe."""
    read, write = os.pipe()
    recording = Recording(write)
    try:
        with InputDevice(read, "/dev/input/event7", has) as device:
            yield recording, device
    finally:
        recording.unplug()
