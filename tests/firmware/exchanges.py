"""Exchanges of a moving board with six motors over one of its ports.

``python -m tests.firmware.exchanges [--number N] [ELF]`` prints, for both ports and 1.0 and 1.5 cycles per
instruction, the exchanges lost of N (1000) at 100 Hz and the longest of them; for the native port also of a
board with three motors.
"""

from __future__ import annotations

import argparse
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


def measure(
    elf: Path, cycles_per_instruction: float, exchanges: int, motors: int = 6, usb: bool = False
) -> Exchanges:
    board = Sam3x(elf, cycles_per_instruction)
    board.run_ms(25)
    if usb:
        board.usb.plug()
        board.run_ms(25)
        if not board.usb.opened:  # the stand-in core does not enumerate
            board.usb.open()
    plant = Motors(board)
    host = Host(board.ask_usb if usb else board.ask_uart)
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
    telemetry = host.telemetry
    assert telemetry is not None
    armed = all(report.state is BoardState.ARMED for report in telemetry.channels.values())
    return Exchanges(exchanges, host.lost, board.uart.overruns, board.resets, worst, furthest, armed)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("elf", type=Path, nargs="?")
    parser.add_argument("--number", type=int, default=1000)
    given = parser.parse_args()
    for usb in (False, True):
        for cycles in (1.0, 1.5):
            for motors in (6, 3) if usb else (6,):
                done = measure(given.elf or build_sketch(), cycles, given.number, motors, usb)
                print("native" if usb else "programming", cycles, motors, done, flush=True)
