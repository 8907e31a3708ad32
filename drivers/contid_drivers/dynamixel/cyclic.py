"""One exchange with every servo: goals out in a sync write, a block of registers back from each.

Both packets leave in one write and the answers are awaited in select. One time-out, computed from the bytes
on the wire, the return delays and the adapter's latency, serves all servos, so a silent one costs no data of
the others.

The block holds, through indirect addresses where the servo has them::

    98 watchdog | 126 current 2, velocity 4, position 4 | 144 voltage, low byte  <- every exchange
    70 hardware error | 64 torque enable | 146 temperature                       <- every n-th as well

The low byte is the whole voltage (an XL330 stays below 25.6 V). It is 0 only when a reset lost the mapping.
Without indirect addresses the plain block 98..146 is read, which lacks the torque enable.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.packets import (
    ALERT,
    STATUS_OVERHEAD,
    Instruction,
    fast_parts,
    sync_read,
    sync_write,
)
from contid_drivers.dynamixel.port import ServoPort

#: Register addresses in the order of the indirect block.
INDIRECT_ORDER: Final = (98, *range(126, 136), 144, 70, 64, 146)


@dataclass(frozen=True, slots=True)
class ServoReading:
    """A decoded block, the current in units of the model; None for registers this exchange did not read."""

    current: int
    velocity: int
    position: int
    alert: bool
    watchdog: int | None = None
    voltage_low: int | None = None
    voltage: int | None = None
    hardware_error: int | None = None
    torque: bool | None = None
    temperature: int | None = None


@dataclass(frozen=True, slots=True)
class CyclicLayout:
    """Address of the block, and its bytes in a lean and in a full exchange."""

    address: int
    lean: int
    full: int
    indirect: bool = False

    def decode(self, data: bytes, alert: bool) -> ServoReading:
        """Decode a block read with this layout."""
        if self.indirect:
            watchdog, current, velocity, position, low = _LEAN.unpack_from(data)
            if len(data) == self.lean:
                return ServoReading(current, velocity, position, alert, watchdog, low)
            error, torque, temperature = data[12:15]
            return ServoReading(
                current, velocity, position, alert, watchdog, low, low, error, bool(torque), temperature
            )
        if self is PLAIN:
            watchdog, current, velocity, position, voltage, temperature = _PLAIN.unpack(data)
            return ServoReading(
                current, velocity, position, alert, watchdog, None, voltage, temperature=temperature
            )
        current, velocity, position = _MOTION.unpack(data)
        return ServoReading(current, velocity, position, alert)


_LEAN: Final = struct.Struct("<BhiiB")
_PLAIN: Final = struct.Struct("<B27xhii8xHB")
_MOTION: Final = struct.Struct("<hii")
INDIRECT: Final = CyclicLayout(208, _LEAN.size, len(INDIRECT_ORDER), indirect=True)
INDIRECT_224: Final = CyclicLayout(224, _LEAN.size, len(INDIRECT_ORDER), indirect=True)
PLAIN: Final = CyclicLayout(98, _PLAIN.size, _PLAIN.size)
#: Only current, velocity and position; for benchmarks.
MOTION: Final = CyclicLayout(126, _MOTION.size, _MOTION.size)


def common_layout(starts: Sequence[int]) -> CyclicLayout:
    """The layout of a bus whose servos have their indirect data at ``starts``; 0 for none.

    A sync read has one address for all: with different starts the plain block is read.
    """
    same = starts[0] if len(set(starts)) == 1 else 0
    return next((each for each in (INDIRECT, INDIRECT_224) if each.address == same), PLAIN)


class Cyclic:
    """The exchange of one bus."""

    def __init__(self, port: ServoPort, ids: Sequence[int], layout: CyclicLayout, fast: bool) -> None:
        self.port = port
        self.ids = tuple(ids)
        self.layout = layout
        self.fast = fast
        self._reads = {
            (size, fast): sync_read(layout.address, size, self.ids, fast)
            for size in (layout.lean, layout.full)
            for fast in (False, True)
        }

    def timeout_s(self, full: bool = True) -> float:
        """Time-out of the answers from the end of the instruction [s]."""
        size = self.layout.full if full else self.layout.lean
        return self._answers_s(size, self.fast) + self.port.latency_s

    def _answers_s(self, size: int, fast: bool) -> float:
        count = len(self.ids)
        if fast:
            return float((8 + count * (size + 4)) * self.port.byte_s + self.port.return_delay_s)
        return float(count * ((size + STATUS_OVERHEAD) * self.port.byte_s + self.port.return_delay_s))

    def run(self, goals: Mapping[int, int], full: bool, fast: bool | None = None) -> dict[int, ServoReading]:
        """Send goals [ticks by id] and read every servo.

        Returns:
            Intact readings by id.

        Raises:
            DeviceLostError: the port failed.
        """
        fast = self.fast if fast is None else fast
        size = self.layout.full if full else self.layout.lean
        wire = self._reads[size, fast]
        if goals:
            encode = reg.GOAL_POSITION.encode
            wire = sync_write(116, 4, ((device, encode(goal)) for device, goal in goals.items())) + wire
        self.port.flush()
        deadline = self.port.send(wire) + self._answers_s(size, fast) + self.port.latency_s
        return self._fast(size, deadline) if fast else self._collect(set(self.ids), size, deadline)

    def again(self, devices: Sequence[int], full: bool, until: float) -> dict[int, ServoReading]:
        """Read some servos once more, if their answers can arrive before ``until`` [monotonic s]."""
        size = self.layout.full if full else self.layout.lean
        port = self.port
        wire = sync_read(self.layout.address, size, devices)
        answers_s = len(devices) * ((size + STATUS_OVERHEAD) * port.byte_s + port.return_delay_s)
        if time.monotonic() + len(wire) * port.byte_s + answers_s > until:
            return {}
        port.flush()
        deadline = min(port.send(wire) + answers_s + port.latency_s, until)
        return self._collect(set(devices), size, deadline)

    def _collect(self, waiting: set[int], size: int, deadline: float) -> dict[int, ServoReading]:
        found: dict[int, ServoReading] = {}
        decode = self.layout.decode
        for packet in self.port.packets(deadline):
            # Skips echoes (instructions) and copies of an answer.
            if (
                packet.instruction == Instruction.STATUS
                and packet.device in waiting
                and len(packet.parameters) == size
            ):
                waiting.discard(packet.device)
                found[packet.device] = decode(packet.parameters, packet.error >= ALERT)
                if not waiting:
                    break
        return found

    def _fast(self, size: int, deadline: float) -> dict[int, ServoReading]:
        sizes = [size] * len(self.ids)
        stream = bytearray()
        whole = 8 + sum(sizes) + 4 * len(sizes)
        parts = []
        while data := self.port.receive(deadline):
            stream += data
            if len(stream) >= whole and len(parts := fast_parts(stream, self.ids, sizes)) == len(sizes):
                break
        else:
            parts = fast_parts(stream, self.ids, sizes)
        return {part.device: self.layout.decode(part.data, part.error >= ALERT) for part in parts}
