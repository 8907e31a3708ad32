"""Cycles of a Dynamixel bus: stock SDK, this driver and the wire limit, side by side from one run.

    python benchmarks/dynamixel_bus.py [--seconds 2] [--servos 4] [--baud 1000000] [--fifo] [--json] [--late]

A cycle is a sync write of every goal and a (fast) sync read of every servo. The bus is emulated in a process
of its own and paced at the baud rate; CPU is that of the driver's process over the wall time, of one core.
Rows with a block of 10 bytes read what the stock SDK reads (current, velocity, position); the blocks of 12
and 15 bytes are what contid runs with: the watchdog read back and a proof that the mapping is intact in every
exchange, temperature, torque and hardware error in every one (15) or every n-th (12). The last rows are the
same with one servo silent.

With --late it counts instead, at 200 Hz through adapters that are 3 to 16 ms late, the samples that belong to
another exchange than the one that returned them: the shafts stand elsewhere in every exchange.

The emulated wire runs with real-time priority where that is permitted, because a wire is not preempted. With
--fifo so does contid, as its control process does; the stock SDK never, because it spins.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import os
import statistics
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from multiprocessing.connection import Connection
from typing import Any

from contid.control.engine.clock import RealClock
from contid.hal import AxisOnBus
from contid_drivers.dynamixel.bus import DynamixelBus
from contid_drivers.dynamixel.exchange.block import INDIRECT, MOTION, CyclicLayout
from contid_drivers.dynamixel.options import DynamixelAxisOptions, DynamixelBusOptions


def real_time(on: bool) -> bool:
    """SCHED_FIFO for this process, or back; False when that is not permitted."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO if on else os.SCHED_OTHER, os.sched_param(50 if on else 0))
    except PermissionError:
        return False
    return True


def serve(pipe: Connection, count: int, baud: int) -> None:
    from contid_drivers.dynamixel.emulator import DynamixelEmulator, Servo

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


@dataclass
class Row:
    """One line of the table."""

    what: str
    baud: int
    bytes_read: int
    cycles_per_s: float
    wire_limit_per_s: float
    cpu_percent: float
    p50_ms: float
    p99_ms: float
    invalid: int
    timeout_ms: float = 0.0


def wire_limit(count: int, size: int, baud: int, fast: bool) -> float:
    """Cycles per second when nothing but the bytes takes time."""
    answer = 8 + count * (size + 4) if fast else count * (size + 11)
    return baud / 10.0 / ((14 + 5 * count) + (14 + count) + answer)


def measure(what: str, baud: int, size: int, limit: float, seconds: float, cycle: Callable[[], int]) -> Row:
    for _ in range(30):
        cycle()
    times, invalid = [], 0
    cpu, start = time.process_time(), time.perf_counter()
    before = start
    while before - start < seconds:
        invalid += cycle()
        after = time.perf_counter()
        times.append(after - before)
        before = after
    wall, used = before - start, time.process_time() - cpu
    times.sort()
    return Row(
        what, baud, size, len(times) / wall, limit, 100.0 * used / wall,
        1e3 * statistics.median(times), 1e3 * times[int(0.99 * len(times))], invalid,
    )  # fmt: skip


def goals() -> Iterator[float]:
    """A slow sine, so that the servos really move."""
    start = time.monotonic()
    while True:
        yield math.pi + 0.2 * math.sin(time.monotonic() - start)


def stock(port: str, count: int, baud: int, seconds: float, fast: bool) -> Row:
    import dynamixel_sdk as sdk

    handler, protocol = sdk.PortHandler(port), sdk.PacketHandler(2.0)
    handler.setBaudRate(baud)
    write: Any = sdk.GroupSyncWrite(handler, protocol, 116, 4)
    read: Any = sdk.GroupSyncRead(handler, protocol, 126, 10)
    for device in range(1, count + 1):
        read.addParam(device)
    goal = goals()

    def cycle() -> int:
        ticks = round(next(goal) / (2 * math.pi) * 4096)
        write.clearParam()
        for device in range(1, count + 1):
            write.addParam(device, list(ticks.to_bytes(4, "little")))
        write.txPacket()
        result = read.fastSyncRead() if fast else read.txRxPacket()
        for device in range(1, count + 1):
            for address, size in ((126, 2), (128, 4), (132, 4)):
                read.getData(device, address, size)
        return 0 if result == 0 else count

    name = f"stock SDK{', fast read' if fast else ''}"
    row = measure(name, baud, 10, wire_limit(count, 10, baud, fast), seconds, cycle)
    handler.closePort()
    return row


def driver(
    port: str,
    count: int,
    baud: int,
    seconds: float,
    fast: bool,
    layout: CyclicLayout,
    every: int = 1,
    note: str = "",
    mute: Callable[[], None] | None = None,
) -> Row:
    """This driver; ``mute`` silences a servo once the bus is open and torque is on."""
    options = DynamixelBusOptions.model_validate({
        "port": port, "baud": baud, "fast_read": "auto" if fast else "off", "telemetry_every": every,
    })  # fmt: skip
    axes = [AxisOnBus(f"r.a{i + 1}", DynamixelAxisOptions(id=i + 1)) for i in range(count)]
    bus = DynamixelBus("servos", options, axes, RealClock(), layout)
    bus.open()
    goal = goals()
    size = layout.full if every == 1 else layout.lean
    name = f"contid{', fast read' if fast else ''}{note}"
    try:
        bus.enable(bus.axes)

        def cycle() -> int:
            angle = next(goal)
            samples = bus.exchange(dict.fromkeys(bus.axes, angle))
            if faults := [sample.fault for sample in samples.values() if sample.fault]:
                raise SystemExit(
                    f"{name}: {faults[0]}; its goals are no longer sent, so the row would flatter"
                )
            return sum(not sample.valid for sample in samples.values())

        if mute is not None:
            mute()
        row = measure(name, baud, size, wire_limit(count, size, baud, fast), seconds, cycle)
        row.timeout_ms = 1e3 * bus._cyclic.timeout_s()  # type: ignore[union-attr]  # the bus is open
    finally:
        from contid.hal import Rest

        bus.disable(bus.axes, Rest.RELAX)
        bus.close()
    return row


def late_samples(ms: float, count: int, fast: bool, exchanges: int = 190) -> tuple[int, int]:
    """Valid samples through an adapter late by ``ms``, and those among them of another exchange."""
    from contid_drivers.dynamixel.emulator import DynamixelEmulator, Servo

    servos = [Servo(i + 1, position_ticks=1000.0 * (i + 1)) for i in range(count)]
    with DynamixelEmulator(servos) as emulator:
        options = DynamixelBusOptions(port=emulator.port, fast_read="auto" if fast else "off")
        axes = [AxisOnBus(f"r.a{i + 1}", DynamixelAxisOptions(id=i + 1)) for i in range(count)]
        bus = DynamixelBus("servos", options, axes, RealClock())
        bus.open()
        emulator.set("late", ms=ms)
        valid = stale = 0
        due = time.monotonic()
        for k in range(exchanges):
            for i, servo in enumerate(servos):
                servo.motion.position = 1000.0 * (i + 1) + 7 * k
            for i, sample in enumerate(bus.exchange({}).values()):
                if sample.valid and sample.value is not None:
                    valid += 1
                    ticks = sample.value / (2.0 * math.pi) * 4096
                    stale += abs(ticks - 1000.0 * (i + 1) - 7 * k) > 0.6
            due += 0.005
            time.sleep(max(0.0, due - time.monotonic()))
        bus.close()
    return valid, stale


def show(row: Row) -> None:
    part = 100 * row.cycles_per_s / row.wire_limit_per_s
    print(
        f"{row.what:34s} {row.baud / 1e6:3g}M {row.bytes_read:3d} B {row.cycles_per_s:7.0f}/s"
        f", {1e3 / row.p50_ms:5.0f}/s by the median, of {row.wire_limit_per_s:5.0f} ({part:3.0f} %)"
        f"  cpu {row.cpu_percent:5.1f} %"
        f"  p50 {row.p50_ms:6.3f}  p99 {row.p99_ms:6.3f} ms  invalid {row.invalid}"
    )


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=2.0)
    parser.add_argument("--servos", type=int, default=4)
    parser.add_argument("--baud", type=int, action="append")
    parser.add_argument("--fifo", action="store_true")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--late", action="store_true")
    given = parser.parse_args()
    if given.late:
        for fast in (False, True):
            for ms in (3, 4, 5, 7, 9, 12, 16):
                valid, stale = late_samples(ms, given.servos, fast)
                read = "fast read" if fast else "plain read"
                asked = 190 * given.servos
                print(f"{ms:2d} ms late, {read}: {valid} of {asked} valid, {stale} of another exchange")
        return
    rows: list[Row] = []

    def done(row: Row) -> None:
        rows.append(row)
        if given.json:
            print(json.dumps(asdict(row)), flush=True)
        else:
            show(row)
            sys.stdout.flush()

    n, seconds = given.servos, given.seconds
    for baud in given.baud or [1000000, 4000000]:
        with emulated(n, baud) as (port, silent):
            for fast in (False, True):
                real_time(False)
                done(stock(port, n, baud, seconds, fast))
                if given.fifo and not real_time(True):
                    print("SCHED_FIFO is not permitted", file=sys.stderr)
                done(driver(port, n, baud, seconds, fast, MOTION))
                done(driver(port, n, baud, seconds, fast, INDIRECT, every=25))
                done(driver(port, n, baud, seconds, fast, INDIRECT))
            for device, which in ((n, "last"), (1, "first")):
                mute = partial(silent, device, True)
                done(
                    driver(port, n, baud, seconds, False, INDIRECT, note=f", {which} servo silent", mute=mute)
                )
                silent(device, False)


if __name__ == "__main__":
    main()
