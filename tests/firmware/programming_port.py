"""Exchanges over the programming port with six moving motors.

``python -m tests.firmware.programming_port [ELF]`` prints, for 1.0 and 1.5 cycles per instruction, the
exchanges lost of 1000 at 100 Hz.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

from contid_drivers.due.codes import BoardState
from tests.firmware.sam3x.board import Sam3x
from tests.firmware.sam3x.build import build_sketch
from tests.firmware.sam3x.cpu import CLOCK_HZ
from tests.firmware.sam3x.host import Host
from tests.firmware.sam3x.plant import Motors

PERIOD_MS = 10
#: Counts per exchange: 6100 edges/s.
STEP = 61
#: The shafts turn back and forth over this many exchanges.
TURN = 60


@dataclass(frozen=True)
class Exchanges:
    asked: int
    lost: int
    overruns: int
    resets: int
    worst_ms: float
    furthest: float
    armed: bool


def measure(elf: Path, cycles_per_instruction: float, exchanges: int, motors: int = 6) -> Exchanges:
    board = Sam3x(elf, cycles_per_instruction)
    board.run_ms(25)
    plant = Motors(board)
    host = Host(board)
    host.configure(motors)
    host.arm(motors)
    start_ms = board.elapsed_ms
    worst = 0.0
    goal = 0
    furthest = 0.0
    for i in range(exchanges):
        goal += STEP if i // TURN % 2 == 0 else -STEP
        begun = board.cpu.cycles
        host.demand(dict.fromkeys(range(motors), goal), timeout_ms=PERIOD_MS)
        worst = max(worst, (board.cpu.cycles - begun) * 1000 / CLOCK_HZ)
        furthest = max(furthest, plant.shaft[motors - 1])
        board.run_ms(max(0.25, start_ms + PERIOD_MS * (i + 1) - board.elapsed_ms))
    told = host.told
    assert told is not None
    armed = all(report.state is BoardState.ARMED for report in told.channels.values())
    return Exchanges(exchanges, host.lost, board.uart.overruns, board.resets, worst, furthest, armed)


if __name__ == "__main__":
    flashed = Path(sys.argv[1]) if len(sys.argv) > 1 else build_sketch()
    for cycles in (1.0, 1.5):
        print(cycles, measure(flashed, cycles, 1000))
