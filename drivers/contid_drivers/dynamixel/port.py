"""The serial port of a servo bus: packets with the times of the wire."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from contid.kit.locked_port import LockedPort
from contid_drivers.dynamixel.exchange.fast_answer import HEAD as FAST_HEAD
from contid_drivers.dynamixel.exchange.fast_answer import PART_OVERHEAD
from contid_drivers.dynamixel.packets import STATUS_OVERHEAD, Packet, take

#: Return Delay Time is at most 254 x 2 us; used until the servos' own values are read.
RETURN_DELAY_MAX_S: Final = 508e-6


class ServoPort(LockedPort):
    """Packets over a serial device; ``latency_s`` is the allowance for the adapter."""

    def __init__(self, device: str, path: str, baud: int, latency_s: float) -> None:
        super().__init__(device, path, baud, latency_s)
        #: Return delay of the slowest servo.
        self.return_delay_s = RETURN_DELAY_MAX_S
        # Answers to a process that held the port before.
        self.drain()

    def status_s(self, size: int) -> float:
        """Time of a status packet with ``size`` parameters on the wire, without stuffing."""
        return (size + STATUS_OVERHEAD) * self.byte_s

    def answers_s(self, count: int, size: int) -> float:
        """Time of the answers of some servos to a sync read, with their return delays."""
        return count * ((size + STATUS_OVERHEAD) * self.byte_s + self.return_delay_s)

    def fast_answer_s(self, count: int, size: int) -> float:
        """Time of the one answer of some servos to a fast sync read, with its return delay."""
        return (FAST_HEAD + count * (size + PART_OVERHEAD)) * self.byte_s + self.return_delay_s

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
