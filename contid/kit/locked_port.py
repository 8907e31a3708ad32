"""A serial port with one owner: writes, and reads with select against monotonic deadlines.

flock binds cooperating programs, TIOCEXCL every process but root's: a vendor's wizard or a terminal program
takes no lock; it would read contid's answers and could write to moving devices.
"""

from __future__ import annotations

import errno
import fcntl
import os
import select
import termios
import time
from contextlib import suppress
from typing import Final

import serial

from contid.errors import DeviceLostError, DeviceNotFoundError
from contid.kit.serial_ports import holders

#: Longest wait for leftovers on the wire.
DRAIN_S: Final = 0.01
#: Errors of a missing or unplugged port, depending on the call; serial.SerialException is an OSError.
PORT_ERRORS: Final = (OSError, ValueError, TypeError, termios.error)


def lock_port(descriptor: int, path: str) -> None:
    """Refuse further opens of this port until `unlock_port`, or until its last descriptor is closed."""
    # An emulator holds the other end of its pseudo terminal, so the flag would outlive a killed owner.
    if not os.path.realpath(path).startswith("/dev/pts/"):
        with suppress(OSError):
            fcntl.ioctl(descriptor, termios.TIOCEXCL)


def unlock_port(descriptor: int) -> None:
    """Allow further opens again; does nothing on a dead port."""
    with suppress(OSError, ValueError):
        fcntl.ioctl(descriptor, termios.TIOCNXCL)


class LockedPort:
    """An open, locked serial device; every failure closes it and raises `DeviceLostError`.

    Args:
        device: name in messages.
        path: path of the device.
        baud: rate [bit/s].
        latency_s: allowance for the adapter.
        echo: the adapter returns what is sent, as those of one-wire buses without a direction control do;
            it is left out of what is received.

    Raises:
        DeviceNotFoundError: missing, not permitted, or in use by another process.
    """

    def __init__(
        self, device: str, path: str, baud: int, latency_s: float = 0.0, *, echo: bool = False
    ) -> None:
        self.device = device
        self.path = path
        self.latency_s = latency_s
        self._echo = bytearray() if echo else None
        #: Time of one byte with its start and stop bit.
        self.byte_s = 10 / baud
        try:
            self.serial = serial.Serial(path, baud, timeout=0, exclusive=True)
            with suppress(OSError, ValueError):
                # Supported by some adapters' kernel drivers only, not by ptys.
                self.serial.set_low_latency_mode(True)
            self.serial.reset_input_buffer()
        except PORT_ERRORS as error:
            raise self._open_error(error) from error
        self.fd = int(self.serial.fileno())
        lock_port(self.fd, path)

    def _open_error(self, error: Exception) -> DeviceNotFoundError:
        number = getattr(error, "errno", None)
        if "exclusively lock" in str(error) or number in (errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK):
            why = f"port {self.path} is in use by {', '.join(holders(self.path)) or 'another process'}"
            return DeviceNotFoundError(self.device, why, "a bus has one owner: stop the other one first")
        if number == errno.EACCES:
            why = f"no permission for {self.path}"
            return DeviceNotFoundError(self.device, why, "install the udev rule, see `contid doctor`")
        return DeviceNotFoundError(self.device, f"port {self.path} does not open: {error}")

    def close(self) -> None:
        """Close the port; idempotent, also on a dead port."""
        if self.fd >= 0:  # after a close the descriptor number may belong to another port
            unlock_port(self.fd)
        self.fd = -1
        with suppress(*PORT_ERRORS):
            self.serial.close()

    def lost(self, error: BaseException | str) -> DeviceLostError:
        """Close the failed port; returns the error to raise."""
        self.close()
        return DeviceLostError(self.device, f"port {self.path} is gone: {error}", "plug it in again")

    def flush(self) -> None:
        """Discard received bytes: late or unexpected answers."""
        if self._echo:
            self._echo.clear()
        try:
            termios.tcflush(self.fd, termios.TCIFLUSH)
        except PORT_ERRORS as error:
            raise self.lost(error) from error

    def drain(self) -> None:
        """Wait for bytes under way and discard them, so that they answer no later request."""
        time.sleep(min(self.latency_s, DRAIN_S))
        self.flush()

    def send(self, wire: bytes) -> float:
        """Write; returns the time at which the last byte will have left [monotonic s]."""
        try:
            if os.write(self.fd, wire) != len(wire):
                raise self.lost("its output buffer is full")
        except PORT_ERRORS as error:
            raise self.lost(error) from error
        if self._echo is not None:
            self._echo += wire
        return time.monotonic() + len(wire) * self.byte_s

    def receive(self, deadline: float) -> bytes:
        """Received bytes, as soon as there are some; b"" after ``deadline`` [monotonic s]."""
        while True:
            try:
                wait = deadline - time.monotonic()
                ready, _, _ = select.select([self.fd], [], [], wait if wait > 0.0 else 0.0)
                if not ready:
                    return b""
                data = os.read(self.fd, 4096)
            except PORT_ERRORS as error:
                raise self.lost(error) from error
            if not data:
                raise self.lost("end of file")
            if not self._echo:
                return data
            if answer := self._without_echo(data, self._echo):
                return answer

    def _without_echo(self, data: bytes, echo: bytearray) -> bytes:
        """What is not the beginning of the echo that is due; a damaged echo is left in, as any noise."""
        size = min(len(data), len(echo))
        if data[:size] != echo[:size]:
            echo.clear()
            return data
        del echo[:size]
        return data[size:]
