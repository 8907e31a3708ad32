"""The fault table of a fleet at random: what dies or stands still, and whether the robot holds in time.

    python -m benchmarks.fleet.faults --repetitions 100 --seed 1 [--first 0]

Each repetition has a bridge, a relay and a program that moves a robot of its own: one fault of the table,
with a random lease, after a random time. The promise is min(lease, lease of the link) + 50 ms, and that what
waited moves nothing afterwards. Exit code 1 when it was broken.
"""

from __future__ import annotations

import argparse
import math
import os
import random
import sys

from benchmarks.on_sigterm import leave_on_sigterm
from tests.support.daemons import armed, daemon
from tests.support.fleet_faults import FAULTS, leases, measure
from tests.support.fleets import NotBegunError

#: Added to the lease: a tick, the look of the daemon, and the way there.
PROMISE_S = 0.05


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--repetitions", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="Number of the first repetition, for pieces.")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    excess: dict[str, list[float]] = {name: [] for name in FAULTS}
    violations = not_begun = 0
    with daemon() as node:
        with node.client() as client:
            armed(client)
        for number in range(options.first, options.first + options.repetitions):
            chosen = random.Random(options.seed * 100_003 + number)
            fault = FAULTS[chosen.choice([*FAULTS])]
            lease_s, delay_s = leases(fault, chosen), chosen.uniform(0.0, 0.5)
            try:
                held_s = measure(node, fault, lease_s, delay_s)
            except NotBegunError as error:
                not_begun += 1
                print(f"{number:4d} {fault.name:20s} not measured: {error}", flush=True)
                continue
            except AssertionError as error:  # it moved again, or something never happened
                violations += 1
                print(f"{number:4d} {fault.name:20s} lease {lease_s:.1f} s: VIOLATION: {error}", flush=True)
                continue
            limit_s = fault.limit_s(lease_s)
            kept = held_s == math.inf if limit_s == math.inf else held_s <= limit_s + PROMISE_S
            violations += not kept
            if limit_s < math.inf:
                excess[fault.name].append(held_s - limit_s)
            print(
                f"{number:4d} {fault.name:20s} lease {lease_s:.1f} s: held after {held_s:.3f} s, "
                f"limit {limit_s:.3f} s {'' if kept else 'VIOLATION'}",
                flush=True,
            )
    for name, values in excess.items():
        if values:
            print(f"{name}: {len(values)} times, {min(values) * 1e3:+.0f} to {max(values) * 1e3:+.0f} ms")
    load = os.getloadavg()[0]
    print(f"{options.repetitions - not_begun} repetitions, {violations} violations; load {load:.1f}")
    return 1 if violations else 0


if __name__ == "__main__":
    leave_on_sigterm()
    sys.exit(main())
