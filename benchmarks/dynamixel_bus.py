"""Cycles of a Dynamixel bus: stock SDK, this driver and the wire, side by side from one run.

    python benchmarks/dynamixel_bus.py [--seconds 2] [--servos 4 --baud 1000000] [--silent] [--normal]

A cycle is a sync write of every goal and a (fast) sync read of every servo. The bus is emulated in a process
of its own and paced at the baud rate; CPU is that of the driver's process over the wall time, of one core.
The rows of a bus are measured in turns, so that each has its share of what else the machine does; the rate by
the median cycle leaves that out. "Wire alone" sends the packets ready-made and only counts the bytes that
return: what this emulation can carry.

Rows with a block of 10 bytes read what the stock SDK reads (current, velocity, position); the blocks of 12
and 15 bytes are what contid runs with: the watchdog read back and a proof that the mapping is intact in every
exchange, temperature, torque and hardware error in every one (15) or every n-th (12). With --silent one servo
is silent in two more rows.

At the end stand the figures that contid has to reach. Among them are, at 200 Hz through adapters that are
3 to 16 ms late, the samples that belong to another exchange than the one that returned them: the shafts stand
elsewhere in every exchange.

The emulated wire runs with real-time priority where that is permitted, because a wire is not preempted; so
does contid, as its control process does, unless --normal is given; the stock SDK never, because it spins.
"""

from __future__ import annotations

import argparse
import json
import logging
import math
import multiprocessing
import os
import statistics
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from multiprocessing.connection import Connection
from typing import Any

from contid.control.engine.clock import RealClock
from contid.errors import DeviceError
from contid.hal import AxisOnBus, Rest
from contid_drivers.dynamixel.bus import DynamixelBus
from contid_drivers.dynamixel.exchange.block import INDIRECT, MOTION, CyclicLayout
from contid_drivers.dynamixel.options import DynamixelAxisOptions, DynamixelBusOptions
from contid_drivers.dynamixel.packets import sync_read, sync_write
from contid_drivers.dynamixel.port import ServoPort

#: The SDK waits this much longer for an answer than its bytes take; so does contid here, for what a busy
#: machine delays. By default it gives up earlier, because a tick does not wait.
SDK_WAIT_MS = 34.0
#: Turns in which the time of a row is spent.
ROUNDS = 4


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
    servos: int
    baud: int
    bytes_read: int
    wire_limit_per_s: float
    invalid: int = 0
    wall_s: float = 0.0
    cpu_s: float = 0.0
    times_s: list[float] = field(default_factory=list, repr=False)

    @property
    def rate_per_s(self) -> float:
        """Cycles per second of the whole time."""
        return len(self.times_s) / self.wall_s

    @property
    def median_rate_per_s(self) -> float:
        """Cycles per second if all were as long as the median one."""
        return 1.0 / statistics.median(self.times_s)

    @property
    def cpu_percent(self) -> float:
        """CPU of this process over the wall time."""
        return 100.0 * self.cpu_s / self.wall_s

    def part(self, rate_per_s: float) -> float:
        """Per cent of the wire limit."""
        return 100.0 * rate_per_s / self.wire_limit_per_s

    def __str__(self) -> str:
        p99_ms = 1e3 * sorted(self.times_s)[int(0.99 * len(self.times_s))]
        return (
            f"{self.what:30s} {self.servos:2d} servos {self.baud / 1e6:3g}M {self.bytes_read:2d} B"
            f" {self.rate_per_s:5.0f}/s, {self.median_rate_per_s:5.0f}/s by the median,"
            f" of {self.wire_limit_per_s:5.0f} ({self.part(self.rate_per_s):3.0f}, "
            f"{self.part(self.median_rate_per_s):3.0f} %)  cpu {self.cpu_percent:5.1f} %"
            f"  p50 {1e3 / self.median_rate_per_s:6.3f}  p99 {p99_ms:6.3f} ms  invalid {self.invalid}"
        )

    @property
    def invalid_permille(self) -> float:
        """Invalid samples per thousand."""
        return 1e3 * self.invalid / (self.servos * len(self.times_s))

    def summary(self) -> dict[str, object]:
        """Its figures, for --json."""
        names = ("what", "servos", "baud", "bytes_read", "wire_limit_per_s", "invalid")
        figures = {name: getattr(self, name) for name in names}
        rates = {name: getattr(self, name) for name in ("rate_per_s", "median_rate_per_s", "cpu_percent")}
        return figures | rates


def wire_limit(count: int, size: int, baud: int, fast: bool) -> float:
    """Cycles per second when nothing but the bytes takes time."""
    answer = 8 + count * (size + 4) if fast else count * (size + 11)
    return baud / 10.0 / ((14 + 5 * count) + (14 + count) + answer)


def measure(row: Row, seconds: float, cycle: Callable[[], int]) -> None:
    for _ in range(30):
        cycle()
    cpu, start = time.process_time(), time.perf_counter()
    before = start
    while before - start < seconds:
        row.invalid += cycle()
        after = time.perf_counter()
        row.times_s.append(after - before)
        before = after
    row.wall_s += before - start
    row.cpu_s += time.process_time() - cpu


def goals() -> Iterator[float]:
    """A slow sine, so that the servos really move."""
    start = time.monotonic()
    while True:
        yield math.pi + 0.2 * math.sin(time.monotonic() - start)


@dataclass(frozen=True)
class Case:
    """A bus and a way to read it."""

    port: str
    count: int
    baud: int
    fast: bool
    seconds: float

    def row(self, what: str, size: int) -> Row:
        """An empty row."""
        name = what + (", fast read" if self.fast else "")
        return Row(name, self.count, self.baud, size, wire_limit(self.count, size, self.baud, self.fast))


def wire_alone(case: Case, row: Row) -> None:
    """Packets ready-made, answers only counted."""
    ids = range(1, case.count + 1)
    port = ServoPort("wire", case.port, case.baud, 0.0)
    port.open()
    here = ((device, (2048).to_bytes(4, "little")) for device in ids)
    wire = sync_write(116, 4, here) + sync_read(126, 10, list(ids), case.fast)
    whole = 8 + case.count * 14 if case.fast else case.count * 21

    def cycle() -> int:
        left, deadline = whole, port.send(wire) + 0.03
        while left > 0 and (data := port.receive(deadline)):
            left -= len(data)
        return case.count if left else 0

    measure(row, case.seconds, cycle)
    port.close()


def stock(case: Case, row: Row) -> None:
    import dynamixel_sdk as sdk

    handler, protocol = sdk.PortHandler(case.port), sdk.PacketHandler(2.0)
    handler.setBaudRate(case.baud)
    write: Any = sdk.GroupSyncWrite(handler, protocol, 116, 4)
    read: Any = sdk.GroupSyncRead(handler, protocol, 126, 10)
    for device in range(1, case.count + 1):
        read.addParam(device)
    goal = goals()

    def cycle() -> int:
        ticks = round(next(goal) / (2 * math.pi) * 4096)
        write.clearParam()
        for device in range(1, case.count + 1):
            write.addParam(device, list(ticks.to_bytes(4, "little")))
        write.txPacket()
        result = read.fastSyncRead() if case.fast else read.txRxPacket()
        for device in range(1, case.count + 1):
            for address, size in ((126, 2), (128, 4), (132, 4)):
                read.getData(device, address, size)
        return 0 if result == 0 else case.count

    measure(row, case.seconds, cycle)
    handler.closePort()


def enable(bus: DynamixelBus) -> None:
    """Open and arm; on a busy machine the emulated wire may be stopped for too long, so three times."""
    for left in (2, 1, 0):
        try:
            bus.open()
            bus.enable(bus.axes)
            return
        except DeviceError:
            bus.close()
            if not left:
                raise


def driver(
    case: Case, row: Row, layout: CyclicLayout, every: int = 1, mute: Callable[[], None] | None = None
) -> None:
    """This driver; ``mute`` silences a servo once the bus is open and torque is on."""
    options = DynamixelBusOptions.model_validate({
        "port": case.port, "baud": case.baud, "fast_read": "auto" if case.fast else "off",
        "telemetry_every": every, "slack_ms": SDK_WAIT_MS, "retry_ms": SDK_WAIT_MS,
    })  # fmt: skip
    axes = [AxisOnBus(f"r.a{i + 1}", DynamixelAxisOptions(id=i + 1)) for i in range(case.count)]
    bus = DynamixelBus("servos", options, axes, RealClock(), layout)
    goal = goals()
    try:
        enable(bus)

        def cycle() -> int:
            invalid = 0
            for sample in bus.exchange(dict.fromkeys(bus.axes, next(goal))).values():
                if sample.fault:
                    raise SystemExit(
                        f"{row.what}: {sample.fault}; its goals are no longer sent, so the row would flatter"
                    )
                invalid += not sample.valid
            return invalid

        if mute is not None:
            mute()
        measure(row, case.seconds, cycle)
    finally:
        bus.disable(bus.axes, Rest.RELAX)
        bus.close()


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


def measured_bus(count: int, baud: int, kinds: Sequence[bool], given: argparse.Namespace) -> list[Row]:
    """The rows of one bus, measured in turns; ``kinds`` are plain and fast reads."""
    rows: list[Row] = []
    seconds = given.seconds / ROUNDS
    with emulated(count, baud) as (port, silent):
        for fast in kinds:
            case = Case(port, count, baud, fast, seconds)
            runs: list[tuple[Row, Callable[[Row], None], bool]] = [
                (case.row("wire alone", 10), partial(wire_alone, case), True),
                (case.row("stock SDK", 10), partial(stock, case), False),
                (case.row("contid", 10), partial(driver, case, layout=MOTION), True),
                (case.row("contid", 12), partial(driver, case, layout=INDIRECT, every=25), True),
                (case.row("contid", 15), partial(driver, case, layout=INDIRECT), True),
            ]
            for _ in range(ROUNDS):
                for row, run, contid in runs:
                    real_time(contid and not given.normal)
                    run(row)
            rows += [row for row, _, _ in runs]
        for device, which in ((count, "last"), (1, "first")) if given.silent else ():
            case = Case(port, count, baud, False, given.seconds)
            row = case.row(f"contid, {which} servo silent", 15)
            driver(case, row, INDIRECT, mute=partial(silent, device, True))
            silent(device, False)
            rows.append(row)
    real_time(False)
    return rows


def bars(rows: Sequence[Row]) -> Iterator[tuple[str, float, float, bool]]:
    """What has to be reached: name, figure, bar, and whether it is reached."""
    by = {(row.what, row.servos, row.baud, row.bytes_read): row for row in rows}
    for baud, bar in ((1000000, 93.0), (4000000, 86.0)):
        for size in (10, 15):
            if (row := by.get(("contid", 4, baud, size))) is None:
                continue
            name = f"4 servos, {baud // 1000000} Mbaud, {size} B"
            for what, rate in (("rate", row.rate_per_s), ("rate by the median", row.median_rate_per_s)):
                part = row.part(rate)
                yield f"{name}: {what}, per cent of the wire limit", part, bar, round(part) >= bar
            if baud == 1000000:
                yield f"{name}: CPU of one core, per cent", row.cpu_percent, 12.0, row.cpu_percent <= 12.0
    for row in rows:
        sdk = by.get((row.what.replace("contid", "stock SDK"), row.servos, row.baud, 10))
        if row.what.startswith("contid") and "silent" not in row.what and sdk is not None:
            name = f"{row.what}, {row.servos} servos, {row.baud // 1000000} Mbaud, {row.bytes_read} B"
            ours, theirs = row.invalid_permille, sdk.invalid_permille
            yield f"{name}: invalid samples per thousand, and of the SDK", ours, theirs, ours <= theirs
    fast = by.get(("contid, fast read", 12, 4000000, 10))
    sdk = by.get(("stock SDK, fast read", 12, 4000000, 10))
    if fast is not None and sdk is not None:
        for what, ours, theirs in (
            ("rate", fast.rate_per_s, sdk.rate_per_s),
            ("rate by the median", fast.median_rate_per_s, sdk.median_rate_per_s),
        ):
            yield f"12 servos, 4 Mbaud, fast read: {what}, and that of the SDK", ours, theirs, ours >= theirs


def late_total() -> tuple[int, int]:
    valid = stale = 0
    for fast in (False, True):
        for ms in (3, 4, 5, 7, 9, 12, 16):
            good, wrong = late_samples(ms, 4, fast)
            print(f"{ms:2d} ms late, {'fast' if fast else 'plain'} read: {good} of 760 valid, {wrong} wrong")
            valid, stale = valid + good, stale + wrong
    return valid, stale


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=2.0, help="per row")
    parser.add_argument("--servos", type=int, help="one bus, with --baud, instead of all that have a bar")
    parser.add_argument("--baud", type=int, default=1000000)
    parser.add_argument("--normal", action="store_true", help="contid without real-time priority")
    parser.add_argument("--silent", action="store_true")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--late", action="store_true", help="only the adapters that are late")
    given = parser.parse_args()
    logging.getLogger("contid_drivers").setLevel(logging.ERROR)
    if given.late:
        late_total()
        return
    both = (False, True)
    buses = [(4, 1000000, both), (4, 4000000, both), (12, 4000000, (True,))]
    if given.servos is not None:
        buses = [(given.servos, given.baud, both)]
    if not given.normal and not real_time(True):
        print("SCHED_FIFO is not permitted; contid runs without it", file=sys.stderr)
    real_time(False)
    rows: list[Row] = []
    for count, baud, kinds in buses:
        print(f"load average {os.getloadavg()[0]:.1f}", file=sys.stderr)
        found = measured_bus(count, baud, kinds, given)
        for row in found:
            print(json.dumps(row.summary()) if given.json else row, flush=True)
        rows += found
    if given.json:
        return
    results = list(bars(rows))
    if given.servos is None:
        _, stale = late_total()
        results.append(("late by 3 to 16 ms: samples of another exchange", stale, 0, stale == 0))
    for name, figure, bar, reached in results:
        print(f"{'reached' if reached else 'MISSED '} {name}: {figure:.4g}, {bar:.4g}")


if __name__ == "__main__":
    main()
