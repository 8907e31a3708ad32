"""One exchange with every servo: goals out in a sync write, a block of registers back from each.

Both packets leave in one write and the answers are awaited in select. One time-out, computed from the bytes
on the wire, the return delays and the adapter's latency, serves all servos, so a silent one costs no data of
the others. Silent ones are last in the order.

An answer names neither its instruction nor its register. Once one is missing it may come late, so from then
on every exchange reads a block of another length (`numbered_blocks`). An answer of another length belongs to
an earlier exchange, is discarded and counted. Bytes keep their order in an adapter, so two complete exchanges
in a row without old bytes prove that nothing is under way, and the usual block is read again.

The block holds, through indirect addresses where the servo has them::

    98 watchdog | 126 current 2, velocity 4, position 4 | 144 voltage, low byte  <- every exchange
    70 hardware error | 64 torque enable | 146 temperature                       <- every n-th as well

The low byte is the whole voltage (an XL330 stays below 25.6 V). It is 0 only when a reset lost the mapping.
Without indirect addresses the plain block 98..146 is read, which lacks the torque enable.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.packets import (
    ALERT,
    STATUS_OVERHEAD,
    Instruction,
    fast_parts,
    fast_start,
    sync_read,
    sync_write,
    take,
)
from contid_drivers.dynamixel.port import ServoPort
from contid_drivers.dynamixel.slack import Slack

#: A length identifies its exchange for this time.
REUSE_S: Final = 0.1
#: Bytes before a block of plain registers that can be read with it.
BEFORE: Final = 24
#: Complete exchanges in a row after which nothing late is expected.
ORDERLY: Final = 2

#: Register addresses in the order of the indirect block.
INDIRECT_ORDER: Final = (98, *range(126, 136), 144, 70, 64, 146)


@dataclass(frozen=True, slots=True)
class ServoReading:
    """A decoded block; None for registers this exchange did not read.

    Attributes:
        current: in units of the model.
        velocity: in units of 0.229 rpm.
        position: count of the servo; 4096 per turn.
        alert: the status packet reports a hardware error.
        watchdog: value of Bus Watchdog, in units of 20 ms.
        voltage_low: low byte of the input voltage; 0 after a reset, which clears the indirect addresses.
        voltage: input voltage in units of 0.1 V.
        hardware_error: bits of Hardware Error Status.
        torque: torque is on.
        temperature: [deg C].
    """

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


@dataclass(frozen=True, slots=True)
class Block:
    """One read: its layout, its place, and the bytes to skip before the layout begins."""

    layout: CyclicLayout
    address: int
    size: int
    skip: int = 0

    def decode(self, data: bytes, alert: bool) -> ServoReading:
        """Decode an answer of this length."""
        layout = self.layout
        used = layout.full if self.size - self.skip >= layout.full else layout.lean
        return layout.decode(data[self.skip : self.skip + used], alert)


def numbered_blocks(layout: CyclicLayout) -> list[Block]:
    """Blocks of distinct lengths, also distinct from the usual ones; short ones first.

    Beyond the mapped bytes the indirect data have few spare ones, so the plain block follows.
    """
    if not layout.indirect:
        return [Block(layout, layout.address - n, layout.full + n, n) for n in range(1, BEFORE + 1)]
    sizes = set(range(layout.lean, reg.INDIRECT_COUNT + 1)) - {layout.lean, layout.full}
    return [Block(layout, layout.address, size) for size in sorted(sizes)] + numbered_blocks(PLAIN)


@dataclass(slots=True)
class AnswerCounts:
    """What went wrong on the wire so far.

    Attributes:
        exchanges: with all servos of the bus.
        late: answers that belong to an earlier exchange; discarded.
        silent: answers that did not come.
        broken: answers that came damaged.
        stalls: exchanges that waited on, because nothing at all had arrived.
    """

    exchanges: int = 0
    late: int = 0
    silent: int = 0
    broken: int = 0
    stalls: int = 0


class Cyclic:
    """The exchange of one bus."""

    def __init__(
        self,
        port: ServoPort,
        ids: Sequence[int],
        layout: CyclicLayout,
        fast: bool,
        slack: Slack | None = None,
        counts: AnswerCounts | None = None,
    ) -> None:
        self.port = port
        self.ids = tuple(ids)
        self.layout = layout
        self.fast = fast
        self.slack = slack or Slack(0.0)
        self.counts = counts or AnswerCounts()
        #: Bytes arrived in the newest exchange, and in the one before.
        self.received = self.received_before = True
        #: Silent servos that answered the newest exchange; only a numbered one proves it.
        self.returned: frozenset[int] = frozenset()
        self._silent: frozenset[int] = frozenset()
        self._usual = {
            full: Block(layout, layout.address, layout.full if full else layout.lean)
            for full in (False, True)
        }
        self._numbered = dict.fromkeys(numbered_blocks(layout), 0.0)
        self._orderly = ORDERLY
        self._reads: dict[tuple[int, bool], bytes] = {}

    def timeout_s(self, full: bool = True) -> float:
        """Time-out of the answers from the end of the instruction [s]."""
        return self._answers_s(self._usual[full].size, self.fast) + self.port.latency_s

    def _block(self, full: bool) -> Block:
        """The block of the next exchange."""
        if self._orderly >= ORDERLY:
            return self._usual[full]
        now = time.monotonic()
        free = (block for block, used in self._numbered.items() if now - used >= REUSE_S)
        block = next(free, None) or min(self._numbered, key=self._numbered.__getitem__)
        self._numbered[block] = now
        return block

    def _answers_s(self, size: int, fast: bool) -> float:
        count = len(self.ids)
        if fast:
            return float((8 + count * (size + 4)) * self.port.byte_s + self.port.return_delay_s)
        return float(count * ((size + STATUS_OVERHEAD) * self.port.byte_s + self.port.return_delay_s))

    @property
    def disturbed(self) -> bool:
        """Servos are silent, or an answer was late."""
        return bool(self._silent or self.counts.late)

    def put_last(self, silent: Collection[int]) -> None:
        """Move silent ids to the end of the order: each one delays, or ends, the answers after it."""
        if self._silent != (now := frozenset(silent)):
            self._silent = now
            self.ids = tuple(sorted(self.ids, key=now.__contains__))
            self._reads.clear()

    def _read(self, block: Block, fast: bool) -> bytes:
        # Sizes differ between blocks, and are quicker to look up.
        key = (block.size, fast)
        if key not in self._reads:
            self._reads[key] = sync_read(block.address, block.size, self.ids, fast)
        return self._reads[key]

    def run(
        self, goals: Mapping[int, int], full: bool, fast: bool | None = None, before: bytes = b""
    ) -> dict[int, ServoReading]:
        """Send ``before``, then goals [ticks by id], and read every servo.

        Returns:
            Intact readings by id.

        Raises:
            DeviceLostError: the port failed.
        """
        fast = self.fast if fast is None else fast
        block = self._block(full)
        wire = self._read(block, fast)
        if goals:
            encode = reg.GOAL_POSITION.encode
            wire = sync_write(116, 4, ((device, encode(goal)) for device, goal in goals.items())) + wire
        self.counts.exchanges += 1
        self.received_before, self.returned = self.received, frozenset()
        # After an exchange without a byte a further wait would only cost the time of the next ones.
        slack_s = self.slack.seconds if self.received_before else 0.0
        late = self.counts.late
        self._discard()
        on_wire_s = self._answers_s(block.size, fast)
        sent = self.port.send(before + wire)
        collect = self._fast if fast else self._collect
        found = collect(self.ids, block, sent + on_wire_s + self.port.latency_s, slack_s)
        if block is self._usual[full]:
            # The usual length proves nothing about a servo that was silent: it is asked again with a number.
            self.returned = self._silent.intersection(found)
            for device in self.returned:
                del found[device]
            if self.returned:
                self._silent -= self.returned
                self._reads.clear()
        missing = [device for device in self.ids if device not in found]
        if not missing:
            self.slack.record(time.monotonic() - sent - on_wire_s)
        orderly = found and self._silent.issuperset(missing) and late == self.counts.late
        self._orderly = self._orderly + 1 if orderly else 0
        return found

    def _discard(self) -> None:
        """Drop what arrived since the last exchange: late answers, copies, or traffic of another host."""
        stale = bytearray()
        while data := self.port.receive(0.0):
            stale += data
        if stale:
            late = 0
            while (packet := take(stream=stale, final=True)) is not None:
                late += packet.instruction == Instruction.STATUS
            self.counts.late += max(late, 1)

    def again(self, devices: Sequence[int], full: bool, until: float) -> dict[int, ServoReading]:
        """Read some servos once more, if their answers can arrive before ``until`` [monotonic s]."""
        block = self._block(full)
        port = self.port
        wire = sync_read(block.address, block.size, devices)
        answers_s = len(devices) * ((block.size + STATUS_OVERHEAD) * port.byte_s + port.return_delay_s)
        if time.monotonic() + len(wire) * port.byte_s + answers_s > until:
            return {}
        port.flush()
        deadline = min(port.send(wire) + answers_s + port.latency_s, until)
        return self._collect(devices, block, deadline, 0.0)

    def _collect(
        self, devices: Collection[int], block: Block, deadline: float, slack_s: float
    ) -> dict[int, ServoReading]:
        found: dict[int, ServoReading] = {}
        waiting = set(devices)
        port = self.port
        stream, unused = bytearray(), 0
        self.received = False
        while waiting:
            data = port.receive(deadline)
            # Late answers to earlier exchanges do not end a stall.
            if not data and not found and not unused and slack_s:
                deadline, slack_s = self._stalled(deadline, slack_s), 0.0
                continue
            stream += data
            unused += len(data)
            self.received = self.received or bool(data)
            while waiting and (packet := take(stream, final=not data)) is not None:
                unused -= len(packet.wire)
                # Skips echoes (instructions) and copies of an answer.
                if packet.instruction != Instruction.STATUS or packet.device not in self.ids:
                    continue
                if len(packet.parameters) != block.size:
                    self.counts.late += 1
                elif packet.device in waiting:
                    waiting.discard(packet.device)
                    found[packet.device] = block.decode(packet.parameters, packet.error >= ALERT)
            if not data:
                break
        self._count_missing(len(waiting), unused > 0)
        return found

    def _stalled(self, deadline: float, slack_s: float) -> float:
        self.counts.stalls += 1
        return deadline + slack_s

    def _count_missing(self, missing: int, damaged: bool) -> None:
        if damaged:
            self.counts.broken += missing
        else:
            self.counts.silent += missing

    def _fast(
        self, devices: Sequence[int], block: Block, deadline: float, slack_s: float
    ) -> dict[int, ServoReading]:
        sizes = [block.size] * len(devices)
        stream = bytearray()
        whole = 8 + sum(sizes) + 4 * len(sizes)
        self.received, parts = False, []
        while True:
            data = self.port.receive(deadline)
            if not data and slack_s and fast_start(stream, whole)[0] == len(stream):
                deadline, slack_s = self._stalled(deadline, slack_s), 0.0
                continue
            stream += data
            self.received = self.received or bool(data)
            if data and len(stream) < whole:
                continue
            start, late = fast_start(stream, whole)
            if not data or len(stream) - start >= whole:
                parts = fast_parts(stream[start:], devices, sizes)
                if not data or len(parts) == len(sizes):
                    break
        self.counts.late += late
        self._count_missing(len(sizes) - len(parts), start < len(stream))
        return {part.device: block.decode(part.data, part.error >= ALERT) for part in parts}
