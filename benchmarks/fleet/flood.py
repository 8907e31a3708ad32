"""Whether a bridge that is flooded can delay a tick: one daemon at 200 Hz, with and without.

    python -m benchmarks.fleet.flood [--rounds 4] [--seconds 6]

In turn, round after round: no bridge; a bridge with a watcher; a bridge that two operators flood with
requests and rows of no move. Lateness of ticks is that which the daemon counts itself, beside a bare loop
that sleeps to the same period in a process of the same priority at the same time. On a busy machine only the
comparison of one run means anything.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
import threading
import time
from bisect import bisect_left
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import Any, Final

from benchmarks import bare_loop
from benchmarks.on_sigterm import leave_on_sigterm
from contid.client import Client
from contid.remote.server.lateness_histogram import BOUNDS_US
from contid_fleet.fleet_file import OperatorFile
from contid_fleet.operator import FleetOperator
from tests.support.daemons import Running, armed, daemon
from tests.support.fleets import bridge

PERIOD_S: Final = 0.005
#: Requests of one flooding operator that are under way.
UNDER_WAY: Final = 64
#: Late by more than a tenth of the period, as everywhere.
LATE_US: Final = 500
KINDS: Final = ("no bridge", "watched", "flooded")


@dataclass
class Seen:
    """Ticks and wake-ups of the bare loop by class of lateness, over all rounds of one kind."""

    ticks: list[int] = field(default_factory=lambda: [0] * (len(BOUNDS_US) + 1))
    bare: list[int] = field(default_factory=lambda: [0] * (len(BOUNDS_US) + 1))
    skipped: int = 0
    requests: int = 0


def flood(endpoint: str, seconds: float, out: Connection) -> None:
    """Ask as fast as answers come; sends how many there were."""
    places, answers = threading.Semaphore(UNDER_WAY), [0]

    def answered(_key: str, _payload: bytes) -> None:
        answers[0] += 1

    requests = [("status", b""), ("describe", b""), ("rows", b'{"move":1,"rows":[[1.0,2.0]]}'), ("ping", b"")]
    with FleetOperator(OperatorFile(fleet="lab", operator="anna", connect=[endpoint])) as operator:
        end_s, number = time.monotonic() + seconds, 0
        while time.monotonic() < end_s:
            if places.acquire(timeout=0.1):
                verb, payload = requests[number % len(requests)]
                number += 1
                operator.net.ask(operator.key("hand1", verb), payload, 1.0, answered, places.release)
    out.send(answers[0])


@contextmanager
def around(kind: str, node: Running, seconds: float, seen: Seen) -> Iterator[None]:
    """What runs beside the daemon."""
    spawn = multiprocessing.get_context("spawn")
    with ExitStack() as stack:
        if kind != "no bridge":
            served = stack.enter_context(bridge({"hand1": node.socket}, telemetry_hz=200.0))
            watcher = stack.enter_context(FleetOperator(served.operator("bob")))
            watcher.net.subscribe(watcher.keys.telemetry("*"), lambda _key, _line: None)
        floods: list[tuple[Any, Connection]] = []
        for _ in range(2 if kind == "flooded" else 0):
            near, far = spawn.Pipe(False)
            process = spawn.Process(target=flood, args=(served.endpoint, seconds + 3.0, far))
            process.start()
            floods.append((process, near))
        time.sleep(2.0)  # each process has begun
        yield
        for process, near in floods:
            seen.requests += near.recv()
            process.join()


def measure(client: Client, seconds: float, seen: Seen) -> None:
    """Lateness of the ticks of some seconds, and of the bare loop meanwhile."""
    before = client.status()
    bare = bare_loop.started(seconds, 1.0 / PERIOD_S)
    time.sleep(seconds)
    after = client.status()
    old, new = (each["lateness_classes"]["counts"] for each in (before, after))
    seen.ticks = [total + b - a for total, a, b in zip(seen.ticks, old, new, strict=True)]
    for late_s in bare_loop.read(bare):
        seen.bare[bisect_left(BOUNDS_US, late_s * 1e6)] += 1
    seen.skipped += after["skipped"] - before["skipped"]


def percentile(counts: list[int], share: float) -> str:
    """The class in which a percentile lies."""
    left = share * sum(counts)
    for bound, count in zip(BOUNDS_US, counts, strict=False):
        left -= count
        if left <= 0.0:
            return f"<= {bound / 1e3:g} ms"
    return f"> {BOUNDS_US[-1] / 1e3:g} ms"


def row(what: str, counts: list[int]) -> str:
    late = sum(counts[BOUNDS_US.index(LATE_US) + 1 :])
    return (
        f"  {what}: {sum(counts)}, late {late / max(sum(counts), 1):.2%}, p99 {percentile(counts, 0.99)}, "
        f"p99.9 {percentile(counts, 0.999)}"
    )


def main() -> int:
    """Read the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=4)
    parser.add_argument("--seconds", type=float, default=6.0)
    options = parser.parse_args()
    found = {kind: Seen() for kind in KINDS}
    with daemon() as node, node.client() as client:
        armed(client)
        for _ in range(options.rounds):
            for kind, seen in found.items():
                with around(kind, node, options.seconds, seen):
                    measure(client, options.seconds, seen)
    for kind, seen in found.items():
        print(f"{kind}: skipped {seen.skipped}, requests answered {seen.requests}")
        print(row("ticks", seen.ticks))
        print(row("bare loop", seen.bare))
    print(f"load {os.getloadavg()[0]:.0f}")
    return 0


if __name__ == "__main__":
    leave_on_sigterm()
    sys.exit(main())
