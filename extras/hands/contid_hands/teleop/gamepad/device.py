"""An open input device of Linux: what it has, its present state, its events (``linux/input.h``)."""

from __future__ import annotations

import errno
import fcntl
import os
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Final, NamedTuple, Self

from contid.errors import ContidError, DeviceLostError
from contid_hands.teleop.gamepad.events import (
    ABSOLUTE,
    BUTTONS,
    EV_ABS,
    EV_KEY,
    EV_REL,
    EVENT,
    RELATIVE,
    EventDecoder,
    InputEvent,
)

#: Numbers of the reading ioctls. The bit maps of a type of event and the absolute axes have a range each: the
#: type, or the code of the axis, is added to the first number of the range.
_EVIOCGID: Final = 0x02
_EVIOCGNAME: Final = 0x06
_EVIOCGKEY: Final = 0x18
_EVIOCGBIT: Final = 0x20
_EVIOCGABS: Final = 0x40
#: ``struct input_absinfo``, and ``struct input_id``: bus, vendor, product, version.
_ABSINFO: Final = struct.Struct("=6i")
_ID: Final = struct.Struct("=4H")
_NAME_BYTES: Final = 256
#: Of the bit maps: KEY_MAX, REL_MAX and ABS_MAX are 0x2ff, 0xf and 0x3f.
_KEY_BYTES, _REL_BYTES, _ABS_BYTES = 96, 2, 8
#: Bytes of one read: 256 events.
_READ_BYTES: Final = EVENT.size * 256
#: Reads of one call; the queue of the kernel is much shorter.
_READS: Final = 64
#: Makers of 3D mice: 3Dconnexion, and Logitech, which made the older ones.
_VENDOR_3DCONNEXION, _VENDOR_LOGITECH = 0x256F, 0x046D


def request_number(number: int, size: int) -> int:
    """The number of a reading ioctl of input devices: ``_IOC(_IOC_READ, 'E', number, size)``."""
    return 2 << 30 | size << 16 | ord("E") << 8 | number


class AbsInfo(NamedTuple):
    """``struct input_absinfo``: the present value of an absolute axis, its range, noise and dead zone."""

    value: int
    minimum: int
    maximum: int
    fuzz: int = 0
    flat: int = 0
    resolution: int = 0


@dataclass(frozen=True, slots=True)
class Capabilities:
    """What a device has.

    Attributes:
        name: as the kernel has it.
        vendor: number of its maker on USB.
        keys: codes of its buttons and keys.
        relative: codes of its relative axes.
        absolute: its absolute axes.
        pressed: codes of the buttons that are pressed now.
    """

    name: str
    vendor: int
    keys: frozenset[int]
    relative: frozenset[int]
    absolute: Mapping[int, AbsInfo]
    pressed: frozenset[int] = frozenset()

    @property
    def kind(self) -> str | None:
        """``spacemouse``, ``gamepad``, or None for another device."""
        # X to RZ have the codes 0 to 5, whether they are absolute or relative.
        six = {*RELATIVE.values()} <= {*self.absolute, *self.relative}
        maker = self.vendor == _VENDOR_3DCONNEXION or (
            self.vendor == _VENDOR_LOGITECH and "space" in self.name.lower()
        )
        if six and maker:
            return "spacemouse"
        sticks = {ABSOLUTE["ABS_X"], ABSOLUTE["ABS_Y"]} <= {*self.absolute}
        buttons = {BUTTONS["BTN_SOUTH"], BUTTONS["BTN_TRIGGER"]} & self.keys
        return "gamepad" if sticks and buttons else None


class InputDevice:
    """Context manager over the descriptor of a device, or of a recorded stream of its events.

    Attributes:
        path: path of the device.
        has: what it has, as of opening.
    """

    def __init__(self, descriptor: int, path: str, has: Capabilities) -> None:
        os.set_blocking(descriptor, False)
        self._descriptor = descriptor
        self.path = path
        self.has = has
        self._decoder = EventDecoder()

    def events(self) -> Iterator[InputEvent]:
        """Events since the last call; does not wait.

        Raises:
            DeviceLostError: the device is gone, or cannot be read.
        """
        for _ in range(_READS):
            try:
                data = os.read(self._descriptor, _READ_BYTES)
            except BlockingIOError:
                return
            except OSError as error:
                raise self._lost(error.strerror or str(error)) from error
            if not data:
                raise self._lost("end of its events")
            yield from self._decoder.feed(data)
        raise self._lost("more events than a device can have")

    def present(self) -> Capabilities:
        """What the device has, with the present state of axes and buttons; a recording has that of its start.

        Raises:
            DeviceLostError: the device is gone.
        """
        try:
            return capabilities(self._descriptor)
        except OSError as error:
            if error.errno in (errno.ENOTTY, errno.EINVAL):
                return self.has
            raise self._lost(error.strerror or str(error)) from error

    def _lost(self, reason: str) -> DeviceLostError:
        return DeviceLostError(
            f"{self.has.name} ({self.path})",
            f"is gone: {reason}; the robot holds",
            "connect it and start again",
        )

    def __enter__(self) -> Self:
        """The device is open already."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: TracebackType | None) -> None:
        os.close(self._descriptor)


def capabilities(descriptor: int) -> Capabilities:
    """What an open device has and its present state.

    Raises:
        OSError: it is no input device, or gone.
    """
    _, vendor, _, _ = _ID.unpack(_query(descriptor, _EVIOCGID, _ID.size))
    name = _query(descriptor, _EVIOCGNAME, _NAME_BYTES).split(b"\0")[0].decode(errors="replace")
    absolute = {
        code: AbsInfo(*_ABSINFO.unpack(_query(descriptor, _EVIOCGABS + code, _ABSINFO.size)))
        for code in _bits(_query(descriptor, _EVIOCGBIT + EV_ABS, _ABS_BYTES))
    }
    return Capabilities(
        name=name,
        vendor=vendor,
        keys=_bits(_query(descriptor, _EVIOCGBIT + EV_KEY, _KEY_BYTES)),
        relative=_bits(_query(descriptor, _EVIOCGBIT + EV_REL, _REL_BYTES)),
        absolute=absolute,
        pressed=_bits(_query(descriptor, _EVIOCGKEY, _KEY_BYTES)),
    )


def open_device(path: str | Path) -> InputDevice:
    """Open an input device.

    Raises:
        ContidError: no such device, no right to read it, or no input device.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except PermissionError:
        remedy = "sudo usermod -aG input $USER, then log in again"
        raise ContidError(f"{path}: no right to read it; {remedy}") from None
    except OSError as error:
        raise ContidError(f"{path}: cannot be opened: {error.strerror}") from None
    try:
        return InputDevice(descriptor, str(path), capabilities(descriptor))
    except OSError:
        os.close(descriptor)
        raise ContidError(f"{path}: is no input device; they are /dev/input/event0 and so on") from None


def _query(descriptor: int, number: int, size: int) -> bytes:
    answer = bytearray(size)
    fcntl.ioctl(descriptor, request_number(number, size), answer)
    return bytes(answer)


def _bits(data: bytes) -> frozenset[int]:
    """Numbers of the bits that are set; correct on little-endian machines, for which wheels are published."""
    return frozenset(bit for bit in range(8 * len(data)) if data[bit // 8] >> bit % 8 & 1)
