"""The serial port of a Due: opened exclusively, read with a deadline."""

from __future__ import annotations

import contextlib
import os
import select
import termios
import time

import serial

from contid.errors import DeviceLostError, DeviceNotFoundError
from contid_drivers.due.frames import FrameReader, seal
from contid_drivers.exclusive import lock_port, unlock_port

#: Exact on both chips of the programming port; the native port ignores it.
BAUD = 250_000
#: Errors of an unplugged port, depending on the call.
PORT_ERRORS = (OSError, serial.SerialException, termios.error)


class DuePort:
    """Frames over a serial device. Every failure of the device closes it and raises `DeviceLostError`."""

    def __init__(self, device: str, path: str) -> None:
        """Open the port.

        Raises:
            DeviceNotFoundError: it cannot be opened.
        """
        self._device = device
        self.path = path
        self.reader = FrameReader()
        try:
            # Non-blocking: waiting is done with select, against a deadline.
            self._serial = serial.Serial(path, BAUD, timeout=0, write_timeout=0, exclusive=True)
        except PORT_ERRORS as error:
            raise DeviceNotFoundError(
                device, f"cannot open {path}: {error}", "check permission (group dialout) and other programs"
            ) from error
        self._fd = self._serial.fileno()
        lock_port(self._fd, path)

    def wire_seconds(self, size: int) -> float:
        """Time of ``size`` bytes on the programming port [s]."""
        return size * 10 / BAUD

    def ask(self, payload: bytes, deadline: float) -> bytes | None:
        """Send a request; return the payload of its answer, None after the deadline.

        Args:
            payload: the request; its third byte is the sequence number.
            deadline: on `time.monotonic`.

        Raises:
            DeviceLostError: the device is gone.
        """
        sequence = payload[2]
        try:
            self._write(seal(payload), deadline)
            while (left := deadline - time.monotonic()) > 0:
                ready, _, _ = select.select([self._fd], [], [], left)
                if not ready:
                    break
                data = os.read(self._fd, 4096)
                if not data:
                    raise OSError("end of file")
                answers = [one for one in self.reader.feed(data) if len(one) > 2 and one[2] == sequence]
                if answers:
                    return answers[-1]
        except PORT_ERRORS as error:
            self.close()
            raise DeviceLostError(
                self._device, f"{self.path} is gone: {error}", "plug it in again"
            ) from error
        return None

    def _write(self, data: bytes, deadline: float) -> None:
        while data:
            _, ready, _ = select.select([], [self._fd], [], max(0.0, deadline - time.monotonic()))
            if not ready:
                return  # the buffer stays full; the caller's time-out follows
            data = data[os.write(self._fd, data) :]

    def close(self) -> None:
        """Close the port; idempotent."""
        if self._serial.is_open:  # after a close the descriptor number may belong to another port
            unlock_port(self._fd)
        with contextlib.suppress(*PORT_ERRORS):
            self._serial.close()
