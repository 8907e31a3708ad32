"""A bus of emulated servos in a process of its own, with real-time priority where that is permitted."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection


def real_time(on: bool) -> bool:
    """SCHED_FIFO for this process, or back; False when that is not permitted."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO if on else os.SCHED_OTHER, os.sched_param(50 if on else 0))
    except PermissionError:
        return False
    return True


def serve(pipe: Connection, count: int, baud: int) -> None:
    from contid_emulate.dynamixel import DynamixelEmulator, Servo

    real_time(True)
    servos = [Servo(i + 1, baud=baud) for i in range(count)]
    for servo in servos:
        servo.memory[9] = 0
        servo.memory[11] = 4
    with DynamixelEmulator(servos) as emulator:
        pipe.send(emulator.port)
        while (message := pipe.recv()) is not None:
            emulator.set("silent", message[0], on=message[1])
            pipe.send("done")


@contextmanager
def emulated(count: int, baud: int) -> Iterator[tuple[str, Callable[[int, bool], None]]]:
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=serve, args=(there, count, baud), daemon=True)
    process.start()

    def silent(device: int, on: bool) -> None:
        here.send((device, on))
        here.recv()

    try:
        yield here.recv(), silent
    finally:
        here.send(None)
        process.join(10)
