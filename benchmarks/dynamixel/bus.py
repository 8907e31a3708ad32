"""Cycles of a Dynamixel bus: stock SDK, this driver and the wire, side by side from one run.

    python -m benchmarks.dynamixel.bus [--seconds 2] [--servos 4 --baud 1000000] [--silent] [--normal]

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
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import partial

from benchmarks.dynamixel.emulated_wire import emulated, real_time
from benchmarks.dynamixel.late import late_total
from benchmarks.dynamixel.rows import Row
from benchmarks.dynamixel.ways import Case, driver, stock, wire_alone

#: Turns in which the time of a row is spent.
ROUNDS = 4


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
                (case.row("contid", 10), partial(driver, case, motion_only=True), True),
                (case.row("contid", 12), partial(driver, case, every=25), True),
                (case.row("contid", 15), partial(driver, case), True),
            ]
            for _ in range(ROUNDS):
                for row, run, contid in runs:
                    real_time(contid and not given.normal)
                    run(row)
            rows += [row for row, _, _ in runs]
        for device, which in ((count, "last"), (1, "first")) if given.silent else ():
            case = Case(port, count, baud, False, given.seconds)
            row = case.row(f"contid, {which} servo silent", 15)
            driver(case, row, mute=partial(silent, device, True))
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
