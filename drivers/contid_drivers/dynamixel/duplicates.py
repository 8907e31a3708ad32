"""Two servos with one id on a bus: both answer at once, and their bits mix.

Answers of equal servos to a ping are equal, so nothing shows. A block of running values (Realtime Tick to
Present Position) differs between them: its answers arrive broken, or two of them for one request.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Final

from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.client import ACYCLIC_LATENCY_S
from contid_drivers.dynamixel.packets import Instruction, build, read_parameters, take
from contid_drivers.dynamixel.port import RETURN_DELAY_MAX_S, ServoPort

#: Reads of the block; one can be equal by chance, or lost to noise.
READS: Final = 12
#: Reads at every start of a run, which must not take long.
QUICK_READS: Final = 4
#: A second servo answers within this time after the first, and the adapter's: its return delay, and a margin.
SECOND_S: Final = RETURN_DELAY_MAX_S + 1e-3
_SIZE: Final = reg.PRESENT_POSITION.address + reg.PRESENT_POSITION.size - reg.REALTIME_TICK.address
#: Broken or double answers that are no noise any more.
_SUSPICIOUS: Final = 3

CAUSE: Final = "two servos have this id, or the cable is bad"
REMEDY: Final = "connect one servo at a time and give it another id: `contid servo set-id`"


@dataclass(frozen=True, slots=True)
class AnswerCount:
    """Answers to a number of reads.

    Attributes:
        single: reads with one intact answer.
        broken: reads with damaged bytes or several answers.
        silent: reads without a byte.
    """

    single: int
    broken: int
    silent: int

    @property
    def duplicated(self) -> bool:
        """True when two servos have this id; noise alone breaks fewer answers."""
        return self.broken >= _SUSPICIOUS


def count_answers(port: ServoPort, device: int, reads: int = READS) -> AnswerCount:
    """Read the running values of an id ``reads`` times and count what arrives."""
    request = build(device, Instruction.READ, read_parameters(reg.REALTIME_TICK.address, _SIZE))
    answer_s = port.status_s(_SIZE)
    allowance_s = port.return_delay_s + max(port.latency_s, ACYCLIC_LATENCY_S)
    single = broken = silent = 0
    for _ in range(reads):
        port.flush()
        deadline = port.send(request) + answer_s + allowance_s
        intact, damaged = _receive(port, device, request, deadline, answer_s + SECOND_S + port.latency_s)
        if intact == 1 and not damaged:
            single += 1
        elif intact or damaged:
            broken += 1
        else:
            silent += 1
            if silent == reads // 2 and not single + broken:
                break
    return AnswerCount(single, broken, silent)


def _receive(
    port: ServoPort, device: int, request: bytes, deadline: float, second_s: float
) -> tuple[int, bool]:
    """Number of intact answers of an id, and whether other bytes arrived; an echo is neither."""
    stream = bytearray()
    intact, used = 0, 0
    while data := port.receive(deadline):
        stream += data
        copy = bytearray(stream)
        intact = used = 0
        while (packet := take(copy)) is not None:
            used += len(packet.wire)
            if packet.wire != request:
                intact += packet.instruction == Instruction.STATUS and packet.device == device
        if intact:
            # A second answer follows the first within its own return delay; a first one may come in parts.
            deadline = min(deadline, time.monotonic() + second_s)
    return intact, len(stream) > used
