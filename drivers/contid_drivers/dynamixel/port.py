"""The serial port of a servo bus: locked for one owner, read with select against monotonic deadlines."""

from __future__ import annotations

import contextlib
import errno
import os
import select
import termios
import time
from collections.abc import Iterator
from typing import Final

import serial

from contid.errors import DeviceLostError, DeviceNotFoundError
from contid_drivers.dynamixel.packets import Packet, take
from contid_drivers.exclusive import lock_port, unlock_port
from contid_drivers.serial_ports import holders

BITS_PER_BYTE: Final = 10
#: Return Delay Time is at most 254 x 2 us; used until the servos' own values are read.
RETURN_DELAY_MAX_S: Final = 508e-6
#: Longest wait for leftovers on the wire.
DRAIN_S: Final = 0.01


class ServoPort:
    """A locked serial device; every failure closes it and raises `DeviceLostError`."""

    def __init__(self, device: str, path: str, baud: int, latency_s: float) -> None:
        self.device = device
        self.path = path
        self.baud = baud
        self.latency_s = latency_s
        #: Return delay of the slowest servo.
        self.return_delay_s = RETURN_DELAY_MAX_S
        self.byte_s = BITS_PER_BYTE / baud
        self.serial: serial.Serial | None = None
        self.fd = -1

    def open(self) -> None:
        """Open, lock and flush.

        Raises:
            DeviceNotFoundError: missing, not permitted, or in use by another process.
        """
        try:
            self.serial = serial.Serial(self.path, self.baud, timeout=0, exclusive=True)
            with contextlib.suppress(OSError, ValueError):
                # Supported by some adapters' kernel drivers only, not by ptys.
                self.serial.set_low_latency_mode(True)
            self.serial.reset_input_buffer()
        except (OSError, ValueError, termios.error) as error:
            raise self._open_error(error) from error
        self.fd = int(self.serial.fileno())
        lock_port(self.fd, self.path)
        # Answers to a process that held the port before may still be on their way.
        self.drain()

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
        if self.serial is not None:
            unlock_port(self.fd)
            with contextlib.suppress(OSError, termios.error):
                self.serial.close()
        self.fd = -1

    def lost(self, error: BaseException | str) -> DeviceLostError:
        """Close the failed port; returns the error to raise."""
        self.close()
        return DeviceLostError(self.device, f"port {self.path} is gone: {error}", "plug it in again")

    def flush(self) -> None:
        """Discard received bytes: late or unexpected answers."""
        try:
            termios.tcflush(self.fd, termios.TCIFLUSH)
        except (OSError, termios.error, TypeError, ValueError) as error:
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
        except OSError as error:
            raise self.lost(error) from error
        return time.monotonic() + len(wire) * self.byte_s

    def receive(self, deadline: float) -> bytes:
        """Received bytes, as soon as there are some; b"" after ``deadline`` [monotonic s]."""
        try:
            wait = deadline - time.monotonic()
            ready, _, _ = select.select([self.fd], [], [], wait if wait > 0.0 else 0.0)
            if not ready:
                return b""
            data = os.read(self.fd, 4096)
        except (OSError, ValueError) as error:
            raise self.lost(error) from error
        if not data:
            raise self.lost("end of file")
        return data

    def packets(self, deadline: float) -> Iterator[Packet]:
        """Intact packets as they arrive, until ``deadline`` [monotonic s]."""
        stream = bytearray()
        while True:
            data = self.receive(deadline)
            stream += data
            while (packet := take(stream, final=not data)) is not None:
                yield packet
            if not data:
                return
