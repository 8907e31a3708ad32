"""One exchange with every servo: goals out in a sync write, a block of registers back from each.

Both packets leave in one write and the answers are awaited in select. One time-out, computed from the bytes
on the wire, the return delays and the adapter's latency, serves all servos, so a silent servo costs no data
of the others. Silent servos are asked last.

An answer names neither its instruction nor its register. Once one is missing it may come late, so from then
on every exchange reads a block of another length (`numbered_blocks`). An answer of another length belongs to
an earlier exchange, is discarded and counted. Bytes keep their order in an adapter, so two complete exchanges
in a row without old bytes prove that nothing is under way, and the usual block is read again.

The blocks are in `block`; how answers are taken is in `answers`.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Collection, Mapping, Sequence
from functools import cache
from itertools import chain
from typing import Final

from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.cycle_time import Slack
from contid_drivers.dynamixel.exchange.answers import AnswerCounts, Receiver, ServoAnswers
from contid_drivers.dynamixel.exchange.block import Block, CyclicLayout, ServoReading, numbered_blocks
from contid_drivers.dynamixel.packets import (
    BROADCAST,
    Instruction,
    build,
    read_parameters,
    sync_read,
    take,
)
from contid_drivers.dynamixel.port import ServoPort

#: A block length is not used again for this time, so that it identifies its exchange.
REUSE_S: Final = 0.1
#: Complete exchanges in a row after which no late answer is expected.
ORDERLY: Final = 2
_GOALS: Final = read_parameters(reg.GOAL_POSITION.address, reg.GOAL_POSITION.size)


class Cyclic:
    """The exchange of one bus."""

    def __init__(
        self, port: ServoPort, ids: Sequence[int], layout: CyclicLayout, slack: Slack, counts: AnswerCounts
    ) -> None:
        self.port = port
        self.ids = tuple(ids)
        self.layout = layout
        #: Reads are fast sync reads.
        self.fast = False
        self.slack = slack
        self.answers = ServoAnswers(port, ids, counts)
        #: Bytes arrived in the exchange before the newest one.
        self.received_before = True
        #: Silent servos that answered the newest exchange; only a numbered one proves it.
        self.returned: frozenset[int] = frozenset()
        #: Servos that did not answer, which are asked last.
        self.silent: frozenset[int] = frozenset()
        self._usual = {
            full: Block(layout, layout.address, layout.full if full else layout.lean)
            for full in (False, True)
        }
        self._numbered = dict.fromkeys(numbered_blocks(layout), 0.0)
        self._orderly = ORDERLY
        self._reads: dict[tuple[int, bool], bytes] = {}
        #: Time of the answers to a plain and to a fast read.
        self._answers_s = (port.answers_s, port.fast_answer_s)

    def timeout_s(self, full: bool = True) -> float:
        """Time-out of the answers from the end of the instruction [s]."""
        return self._answers_s[self.fast](len(self.ids), self._usual[full].size) + self.port.latency_s

    def _numbered_block(self) -> Block:
        """The block of an exchange during which late answers may come."""
        now = time.monotonic()
        free = (block for block, used in self._numbered.items() if now - used >= REUSE_S)
        block = next(free, None) or min(self._numbered, key=self._numbered.__getitem__)
        self._numbered[block] = now
        return block

    def put_last(self, silent: Collection[int]) -> None:
        """Move silent ids to the end of the order: each one delays, or ends, the answers after it.

        Of several, another one is asked first in every exchange: those behind a dead one may be alive.
        """
        now = frozenset(silent)
        if self.silent != now or len(now) > 1:
            last = [device for device in self.ids if device in now]
            self.ids = (*(device for device in self.ids if device not in now), *last[1:], *last[:1])
            self.silent = now
            self._reads.clear()

    def _read(self, block: Block, fast: bool) -> bytes:
        """The packet that reads a block; kept by its size, which differs between blocks."""
        packet = sync_read(block.address, block.size, self.ids, fast)
        self._reads[block.size, fast] = packet
        return packet

    def run(
        self,
        goals: Mapping[int, int],
        full: bool,
        fast: bool | None = None,
        before: bytes = b"",
        each: Receiver | None = None,
    ) -> dict[int, ServoReading]:
        """Send ``before``, then goals [ticks by id], and read every servo.

        Args:
            goals: goal positions by id; servos without one are only read.
            full: read the full block.
            fast: read with a fast sync read; None as usual.
            before: packets that get no answer.
            each: gets every intact reading while the next ones are on the wire.

        Returns:
            Intact readings by id.

        Raises:
            DeviceLostError: the port failed.
        """
        fast = self.fast if fast is None else fast
        block = self._usual[full] if self._orderly >= ORDERLY else self._numbered_block()
        read = self._reads.get((block.size, fast)) or self._read(block, fast)
        wire = before + (_goal_packet(goals) if goals else b"") + read
        early = self.port.receive(0.0)
        stale = self._discard(early) if early else 0
        sent = self.port.send(wire)
        # What the instruction does not depend on follows it, to keep the pause before it short.
        counts = self.answers.counts
        counts.exchanges += 1
        counts.late += stale
        late = counts.late
        self.received_before = self.answers.received
        # After an exchange without a byte a further wait would only cost the time of the next ones.
        slack_s = self.slack.seconds if self.received_before else 0.0
        on_wire_s = self._answers_s[fast](len(self.ids), block.size)
        # An answer of the usual length from a servo that was silent may be a late one: the next exchange
        # reads a block of another length from it.
        unproven = self.silent if block is self._usual[full] else frozenset()

        def take_proven(device: int, reading: ServoReading) -> None:
            if device not in unproven and each is not None:
                each(device, reading)

        take_answers = self.answers.fast if fast else self.answers.plain
        deadline = sent + on_wire_s + self.port.latency_s
        found = take_answers(self.ids, block, deadline, slack_s, take_proven if unproven else each)
        self.returned = unproven.intersection(found)
        if self.returned:
            found = {device: reading for device, reading in found.items() if device not in unproven}
            self.silent -= self.returned
            self._reads.clear()
        complete = len(found) == len(self.ids)
        if complete:
            self.slack.record(time.monotonic() - sent - on_wire_s)
        as_expected = complete or (found and self.silent.issuperset(set(self.ids) - found.keys()))
        orderly = as_expected and not stale and late == counts.late
        self._orderly = self._orderly + 1 if orderly else 0
        return found

    def _discard(self, early: bytes) -> int:
        """Drop what arrived since the last exchange: late answers, copies, or traffic of another host.

        Returns:
            The number of late answers; at least 1.
        """
        stale = bytearray(early)
        while data := self.port.receive(0.0):
            stale += data
        late = 0
        while (packet := take(stream=stale, final=True)) is not None:
            late += packet.instruction == Instruction.STATUS
        return max(late, 1)

    def read_again(self, devices: Sequence[int], full: bool, until: float, each: Receiver) -> None:
        """Read some servos once more, if their answers can arrive before ``until`` [monotonic s]."""
        block = self._usual[full] if self._orderly >= ORDERLY else self._numbered_block()
        port = self.port
        wire = sync_read(block.address, block.size, devices)
        answers_s = port.answers_s(len(devices), block.size)
        if time.monotonic() + len(wire) * port.byte_s + answers_s > until:
            return
        port.flush()
        deadline = min(port.send(wire) + answers_s + port.latency_s, until)
        self.answers.plain(devices, block, deadline, until - deadline, each)


@cache
def _goals_of(count: int) -> struct.Struct:
    return struct.Struct("<" + count * "Bi")


def _goal_packet(goals: Mapping[int, int]) -> bytes:
    """A sync write of Goal Position."""
    values = _goals_of(len(goals)).pack(*chain.from_iterable(goals.items()))
    return build(BROADCAST, Instruction.SYNC_WRITE, _GOALS + values)
