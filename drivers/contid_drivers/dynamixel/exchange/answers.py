"""Takes the answers of an exchange from the port, each one as soon as it has arrived.

A sample is made from an answer while the next ones are still on the wire, so that after the last byte little
is left to do before the next instruction.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TypeAlias

from contid_drivers.dynamixel.exchange.block import Block, ServoReading
from contid_drivers.dynamixel.exchange.fast_answer import FastAnswer
from contid_drivers.dynamixel.packets import (
    ALERT,
    STATUS_HEAD,
    STATUS_OVERHEAD,
    Instruction,
    status_head,
    take,
    take_status,
)
from contid_drivers.dynamixel.port import ServoPort

#: Receives an intact reading and the id it is from.
Receiver: TypeAlias = Callable[[int, ServoReading], None]


@dataclass(slots=True)
class AnswerCounts:
    """What went wrong on the wire so far.

    Attributes:
        exchanges: number of exchanges with all servos of the bus.
        late: answers that belong to an earlier exchange; discarded.
        silent: answers that did not come.
        broken: answers that came damaged.
        stalls: exchanges that waited beyond their time-out, because nothing at all had arrived.
    """

    exchanges: int = 0
    late: int = 0
    silent: int = 0
    broken: int = 0
    stalls: int = 0


class ServoAnswers:
    """Takes the answers of the servos on one port.

    Args:
        port: where they arrive.
        ids: ids of all its servos.
        counts: what went wrong, updated.
    """

    def __init__(self, port: ServoPort, ids: Iterable[int], counts: AnswerCounts) -> None:
        self.port = port
        self.counts = counts
        self._ids = frozenset(ids)
        #: A byte arrived in the newest exchange.
        self.received = True
        #: No byte had arrived at the time-out of the newest exchange, so it waited for the slack as well.
        self.stalled = False

    def plain(
        self, devices: Collection[int], block: Block, deadline: float, slack_s: float, each: Receiver | None
    ) -> dict[int, ServoReading]:
        """Take the answers to a sync read; returns the intact ones by device.

        Args:
            devices: asked.
            block: asked for; answers of other lengths belong to earlier exchanges.
            deadline: time of the last answer [monotonic s].
            slack_s: wait this much longer if nothing at all arrived.
            each: called once per device that answers, as soon as it does.
        """
        found: dict[int, ServoReading] = {}
        waiting = set(devices)
        heads, decode = _heads(tuple(devices), block.size), block.decode
        port, stream, unused = self.port, bytearray(), 0
        self.received = self.stalled = False
        while waiting:
            data = port.receive(deadline)
            # Late answers to earlier exchanges do not end a stall.
            if not data and len(waiting) == len(devices) and not unused and slack_s:
                deadline, slack_s = self._stalled(deadline, slack_s), 0.0
                continue
            stream += data
            unused += len(data)
            self.received = self.received or bool(data)
            while waiting and stream:
                device = heads.get(bytes(stream[:STATUS_HEAD]))
                if device in waiting and (answer := take_status(stream, block.size)) is not None:
                    unused -= block.size + STATUS_OVERHEAD
                    error, parameters = answer
                elif (packet := take(stream, final=not data)) is not None:
                    unused -= len(packet.wire)
                    device, error, parameters = packet.device, packet.error, packet.parameters
                    # Skips echoes (instructions) and copies of an answer.
                    if packet.instruction != Instruction.STATUS or device not in self._ids:
                        continue
                    if len(parameters) != block.size:
                        self.counts.late += 1
                        continue
                    if device not in waiting:
                        continue
                else:
                    break
                waiting.discard(device)
                found[device] = reading = decode(parameters, error >= ALERT)
                if each is not None:
                    each(device, reading)
            if not data:
                break
        if waiting:
            self._count_missing(len(waiting), unused > 0)
        return found

    def fast(
        self, devices: Sequence[int], block: Block, deadline: float, slack_s: float, each: Receiver | None
    ) -> dict[int, ServoReading]:
        """Take the answer to a fast sync read, up to its first damaged part; arguments as in `plain`."""
        found: dict[int, ServoReading] = {}
        answer, decode = FastAnswer(devices, block.size), block.decode
        self.received = self.stalled = False
        while answer.missing:
            data = self.port.receive(deadline)
            if not data and slack_s and not answer.started:
                deadline, slack_s = self._stalled(deadline, slack_s), 0.0
                continue
            self.received = self.received or bool(data)
            for device, error, parameters in answer.feed(data):
                found[device] = reading = decode(parameters, error >= ALERT)
                if each is not None:
                    each(device, reading)
            if not data:
                break
        self.counts.late += answer.late
        if answer.missing:
            self._count_missing(answer.missing, answer.started)
        return found

    def _stalled(self, deadline: float, slack_s: float) -> float:
        self.counts.stalls += 1
        self.stalled = True
        return deadline + slack_s

    def _count_missing(self, missing: int, damaged: bool) -> None:
        if damaged:
            self.counts.broken += missing
        else:
            self.counts.silent += missing


@cache
def _heads(devices: tuple[int, ...], size: int) -> dict[bytes, int]:
    return {status_head(device, size): device for device in devices}
