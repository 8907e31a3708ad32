"""An emulated SAM3X8E with six motors behind a pty: ``python -m tests.firmware.sam3x.serve LINK [ELF]``.

``--pressure`` makes it a pressure board with six regulators. The native port of the board is the pty. Board
time follows this computer's clock as far as it is fast enough (it is 5 to 10 times too slow); the last line
printed gives both, and the shafts in counts or the pressures in bar. ``--cycles`` makes instructions longer,
so that fewer are emulated per millisecond.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import signal
import time
import tty
from pathlib import Path

from tests.firmware.sam3x.board import Sam3x
from tests.firmware.sam3x.build import build_sketch
from tests.firmware.sam3x.plant import STEP, Motors, Regulators

CHUNK_MS = 0.5


def serve(link: Path, elf: Path, cycles_per_instruction: float, pressure: bool) -> None:
    """Run until SIGTERM."""
    board = Sam3x(elf, cycles_per_instruction)
    if pressure:
        board.jumper()
    board.run_ms(25)
    if elf == build_sketch():
        board.usb.open()
    else:
        board.usb.plug()
    board.run_ms(25)
    board.cpu.quantum = 512
    plant = Regulators(board, step=4 * STEP) if pressure else Motors(board, step=4 * STEP)
    master, slave = os.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)
    link.unlink(missing_ok=True)
    link.symlink_to(os.ttyname(slave))
    print("ready", flush=True)
    ends: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _: ends.append(number))
    highest = [0.0] * 6
    start_s, start_ms, sent = time.monotonic(), board.elapsed_ms, len(board.usb.received)
    while not ends:
        with contextlib.suppress(BlockingIOError):
            if data := os.read(master, 4096):
                board.usb.send(data)
        board.run_ms(CHUNK_MS)
        if isinstance(plant, Regulators):
            highest = [max(pair) for pair in zip(highest, plant.pressure_bar, strict=True)]
        if len(board.usb.received) > sent:
            sent += os.write(master, board.usb.received[sent:])
        ahead_s = (board.elapsed_ms - start_ms) / 1000 - (time.monotonic() - start_s)
        if ahead_s > 0:
            time.sleep(ahead_s)
    link.unlink()
    wall_ms = (time.monotonic() - start_s) * 1000
    figures = {
        "board_ms": board.elapsed_ms - start_ms,
        "wall_ms": wall_ms,
        "resets": board.resets,
        "shaft": plant.shaft if isinstance(plant, Motors) else None,
        "bar": plant.pressure_bar if isinstance(plant, Regulators) else None,
        "highest_bar": highest,
    }
    print(json.dumps(figures), flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("link", type=Path)
    parser.add_argument("elf", type=Path, nargs="?")
    parser.add_argument("--pressure", action="store_true")
    parser.add_argument("--cycles", type=float, default=6.0)
    given = parser.parse_args()
    serve(given.link, given.elf or build_sketch(), given.cycles, given.pressure)
