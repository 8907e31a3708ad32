"""The serial port of a servo bus: packets with the times of the wire."""

from __future__ import annotations

import os
import termios
import time
from collections.abc import Iterator
from typing import Final

from contid_drivers.dynamixel.packets import STATUS_OVERHEAD, Packet, take
from contid_drivers.locked_port import PORT_ERRORS, LockedPort

#: Return Delay Time is at most 254 x 2 us; used until the servos' own values are read.
RETURN_DELAY_MAX_S: Final = 508e-6
#: Longest wait for leftovers on the wire.
DRAIN_S: Final = 0.01


class ServoPort(LockedPort):
    """Packets over a serial device; ``latency_s`` is the allowance for the adapter."""

    def __init__(self, device: str, path: str, baud: int, latency_s: float) -> None:
        super().__init__(device, path, baud)
        self.latency_s = latency_s
        #: Return delay of the slowest servo.
        self.return_delay_s = RETURN_DELAY_MAX_S
        # Answers to a process that held the port before.
        self.drain()

    def status_s(self, size: int) -> float:
        """Time of a status packet with ``size`` parameters on the wire, without stuffing."""
        return (size + STATUS_OVERHEAD) * self.byte_s

    def flush(self) -> None:
        """Discard received bytes: late or unexpected answers."""
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
        return time.monotonic() + len(wire) * self.byte_s

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
