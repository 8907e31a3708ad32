"""The serial port of a servo bus: the SDK's port handler without its busy loops and wall clock.

What is wrong in the stock handler, measured: every read spins on a zero time-out, deadlines are on the wall
clock with 34 ms of slack, an unplug leaves the port busy for ever, and anybody may open the device a second
time. Here reads block in select, deadlines are monotonic and computed from bytes, return delay and USB
latency, a failed descriptor is a `DeviceLostError`, and the device is locked for one owner.
"""

# ruff: noqa: N802 - the methods below the line carry the names of the SDK they override

from __future__ import annotations

import contextlib
import errno
import os
import select
import termios
import time
from typing import Final

import serial
from dynamixel_sdk.port_handler import PortHandler

from contid.errors import DeviceLostError, DeviceNotFoundError
from contid_drivers.exclusive import lock_port, unlock_port
from contid_drivers.serial_ports import holders

BITS_PER_BYTE: Final = 10
#: Return Delay Time is at most 254 x 2 us; used until the servos were asked.
RETURN_DELAY_MAX_S: Final = 508e-6
#: Outside the tick a time-out may be long, and has to be: an answer that comes after it would be taken for
#: the answer to the next request of the same servo.
ACYCLIC_LATENCY_S: Final = 0.03
#: Longest wait for leftovers on the wire.
DRAIN_S: Final = 0.01


class BlockingPort(PortHandler):  # type: ignore[misc]  # the SDK has no types
    """Port handler of the SDK on a locked device, blocking reads and the monotonic clock [ms, as the SDK]."""

    def __init__(self, device: str, path: str, baud: int, latency_s: float) -> None:
        super().__init__(path)
        self.device = device
        self.baudrate = baud
        self.latency_s = latency_s
        #: Return delay of the slowest servo.
        self.return_delay_s = RETURN_DELAY_MAX_S
        self.byte_s = BITS_PER_BYTE / baud
        self.fd = -1
        self._sent_until = 0.0
        self._deadline = 0.0

    # -- life ----------------------------------------------------------------------------------------------

    def open(self) -> None:
        """Open, lock and flush.

        Raises:
            DeviceNotFoundError: missing, not permitted, or somebody else's.
        """
        try:
            self.ser = serial.Serial(self.port_name, self.baudrate, timeout=0, exclusive=True)
            with contextlib.suppress(OSError, ValueError):
                # Only adapters whose kernel driver knows it; ptys do not.
                self.ser.set_low_latency_mode(True)
            self.ser.reset_input_buffer()
        except (OSError, ValueError, termios.error) as error:
            raise self._not_opened(error) from error
        self.fd = int(self.ser.fileno())
        lock_port(self.fd, self.port_name)
        # Answers to a process that held the port a moment ago may still be on their way.
        self.drain()
        self.is_open = True
        self.is_using = False
        self.tx_time_per_byte = 1e3 * self.byte_s

    def _not_opened(self, error: Exception) -> DeviceNotFoundError:
        others = holders(self.port_name)
        number = getattr(error, "errno", None)
        if "exclusively lock" in str(error) or number in (errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK):
            return DeviceNotFoundError(
                self.device,
                f"port {self.port_name} is in use by {', '.join(others) or 'another process'}",
                "a bus has one owner: stop the other one first",
            )
        if number == errno.EACCES:
            return DeviceNotFoundError(
                self.device,
                f"no permission for {self.port_name}",
                "install the udev rule, see `contid doctor`",
            )
        return DeviceNotFoundError(self.device, f"port {self.port_name} does not open: {error}")

    def close(self) -> None:
        """Let the port go; may be called twice and on a dead port."""
        if self.ser is not None:
            unlock_port(self.fd)
            with contextlib.suppress(OSError, termios.error):
                self.ser.close()
        self.fd = -1
        self.is_open = self.is_using = False

    def lost(self, error: BaseException | str) -> DeviceLostError:
        """The port failed: close it and give the error to raise."""
        self.close()
        return DeviceLostError(self.device, f"port {self.port_name} is gone: {error}", "plug it in again")

    # -- bytes ---------------------------------------------------------------------------------------------

    def flush(self) -> None:
        """Throw away what came late or unasked."""
        try:
            termios.tcflush(self.fd, termios.TCIFLUSH)
        except (OSError, termios.error, TypeError, ValueError) as error:
            raise self.lost(error) from error

    def drain(self) -> None:
        """Let what is under way arrive and throw it away, or it is taken for an answer to what follows."""
        time.sleep(min(self.latency_s, DRAIN_S))
        self.flush()

    def send(self, wire: bytes) -> float:
        """Write; returns when the last byte will have left, on the monotonic clock [s]."""
        try:
            if os.write(self.fd, wire) != len(wire):
                raise self.lost("it takes no more data")
        except OSError as error:
            raise self.lost(error) from error
        self._sent_until = time.monotonic() + len(wire) * self.byte_s
        return self._sent_until

    def receive(self, deadline: float) -> bytes:
        """Whatever has come, as soon as something has; b"" when nothing came until ``deadline``."""
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

    # -- what the SDK calls --------------------------------------------------------------------------------

    def openPort(self) -> bool:
        """See `open`."""
        self.open()
        return True

    def closePort(self) -> None:
        """See `close`."""
        self.close()

    def clearPort(self) -> None:
        """See `flush`."""
        self.flush()

    def writePort(self, packet: list[int] | bytes) -> int:
        """See `send`."""
        self.send(bytes(packet))
        return len(packet)

    def readPort(self, length: int) -> bytes:
        """At most ``length`` bytes, waiting for the first of them until the packet's time-out."""
        if length <= 0:
            return b""
        try:
            wait = self._deadline - time.monotonic()
            ready, _, _ = select.select([self.fd], [], [], max(0.0, wait))
            return os.read(self.fd, length) if ready else b""
        except (OSError, ValueError) as error:
            raise self.lost(error) from error

    def setPacketTimeout(self, packet_length: int) -> None:
        """Time-out of one answer: rest of the sending, return delay, its bytes, and the adapter's latency."""
        start = max(self._sent_until, time.monotonic())
        self._deadline = start + self.return_delay_s + packet_length * self.byte_s
        self._deadline += max(self.latency_s, ACYCLIC_LATENCY_S)

    def setPacketTimeoutMillis(self, msec: float) -> None:
        """Time-out by the SDK's own reckoning (broadcast ping)."""
        self._deadline = time.monotonic() + msec / 1e3

    def isPacketTimeout(self) -> bool:
        """True once the time-out is over."""
        return time.monotonic() > self._deadline

    @property
    def deadline(self) -> float:
        """End of the present time-out [s]."""
        return self._deadline

    def getCurrentTime(self) -> float:
        """Monotonic [ms]."""
        return time.monotonic() * 1e3
