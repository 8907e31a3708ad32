"""Effect of an order of 50 000 rows on the tick and on the daemon's other clients.

``python -m benchmarks.long_order [--rows 50000] [--rounds 3]``. `contid run hand --mock` at 200 Hz,
recorded. One client streams a timed trajectory of these rows, which the daemon checks and passes on; another
one requests the status continuously, and a third stops the robots while it is being played. Printed per
phase: how late ticks started, the longest time between two ticks and the longest tick, and how long answers
took; the phase before the order is the baseline of the same run.
"""

from __future__ import annotations

import argparse
import itertools
import math
import signal
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.flood import await_there
from contid.client import Client
from contid.session.read import Session

COLUMNS = ("t_s", "left.x_mm", "left.y_mm", "right.x_mm", "right.y_mm")


def rows(count: int) -> list[list[float]]:
    """Both fingers on small circles, a row per tick."""
    out = []
    for number in range(count):
        angle = 0.004 * number
        x, y = 2.0 * math.sin(angle), 70.0 + 2.0 * math.cos(angle)
        out.append([0.005 * number, -8.0 + x, y, 108.0 - x, y])
    return out


class Asking(threading.Thread):
    """Requests the status continuously; records the time and latency of each answer."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path = path
        self._ended = threading.Event()
        self.answers: list[tuple[float, float]] = []

    def run(self) -> None:
        """Until stopped."""
        with Client(self._path, name="asking") as client:
            while not self._ended.wait(0.005):
                begin_s = time.monotonic()
                client.status()
                self.answers.append((begin_s, time.monotonic() - begin_s))

    def stop(self) -> None:
        """No further request."""
        self._ended.set()
        self.join()


@dataclass
class Phase:
    """One part of the order's life, over all rounds [s]."""

    lasts: list[float] = field(default_factory=list)
    lateness: list[float] = field(default_factory=list)
    gaps: list[float] = field(default_factory=list)
    work: list[float] = field(default_factory=list)
    answers: list[float] = field(default_factory=list)


def one_round(folder: Path, count: int, phases: dict[str, Phase]) -> float:
    """One run; returns how long the stop while playing took to be answered [s]."""
    path, session = folder / "s", folder / "run.mcap"
    session.unlink(missing_ok=True)
    own = [sys.executable, "-m", "contid", "run", "hand", "--mock", "--socket", str(path)]
    daemon = subprocess.Popen(
        [*own, "--record", str(session)], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL
    )
    try:
        await_there(path, {"HOLD"})
        asking = Asking(path)
        with Client(path) as client, Client(path) as person:
            asking.start()
            marks = [time.monotonic()]
            time.sleep(2.0)
            marks.append(time.monotonic())
            move = client.request("move", columns=list(COLUMNS))["move"]
            table = rows(count)
            for at in range(0, count, 256):
                client.request("rows", move=move, rows=table[at : at + 256])
            marks.append(time.monotonic())
            client.request("end", move=move)  # answered when it was checked, handed over and begun
            marks.append(time.monotonic())
            time.sleep(2.0)
            marks.append(time.monotonic())
            begin_s = time.monotonic()
            person.estop()
            stop_s = time.monotonic() - begin_s
            asking.stop()
    finally:
        daemon.send_signal(signal.SIGINT)
        daemon.wait(60)
    ticks = list(Session(session).ticks())
    for phase, begin_s, end_s in zip(phases.values(), marks, marks[1:], strict=False):
        inside = [tick for tick in ticks if begin_s <= tick.deadline_s < end_s]
        phase.lasts.append(end_s - begin_s)
        phase.lateness += [tick.lateness_s for tick in inside]
        begins = [tick.deadline_s + tick.lateness_s for tick in inside]
        phase.gaps += [after - before for before, after in itertools.pairwise(begins)]
        phase.work += [tick.work_s for tick in inside]
        phase.answers += [took for at, took in asking.answers if begin_s <= at < end_s]
    return stop_s


def shown(values: list[float]) -> str:
    """p50, p99 and greatest [ms]."""
    ordered = sorted(values)
    at = [ordered[min(int(share * len(ordered)), len(ordered) - 1)] for share in (0.5, 0.99, 1.0)]
    return " / ".join(f"{1e3 * value:.2f}" for value in at)


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.long_order", description=__doc__)
    parser.add_argument("--rows", type=int, default=50_000)
    parser.add_argument("--rounds", type=int, default=3)
    asked = parser.parse_args()
    phases = {name: Phase() for name in ("before", "rows are sent", "checked, handed over", "played")}
    stops = []
    with tempfile.TemporaryDirectory(prefix="contid-") as name:
        for _ in range(asked.rounds):
            stops.append(one_round(Path(name), asked.rows, phases))
    print(f"{asked.rows} rows, {asked.rounds} rounds; p50 / p99 / greatest [ms]")
    heads = ("lasts s", "lateness", "between ticks", "work of a tick", "answers")
    print(f"{'':<22}{heads[0]:>8}" + "".join(f"{head:>24}" for head in heads[1:]))
    for phase_name, phase in phases.items():
        cells = [shown(each) for each in (phase.lateness, phase.gaps, phase.work, phase.answers)]
        print(f"{phase_name:<22}{max(phase.lasts):>8.1f}" + "".join(f"{cell:>24}" for cell in cells))
    print(f"estop while it is played, answered after {1e3 * max(stops):.1f} ms at most")


if __name__ == "__main__":
    main()
