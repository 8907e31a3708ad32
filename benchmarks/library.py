"""The library: rows of `Robot`, steps of `Sim`, and set-points of `Client.servo` beside `move`.

``python -m benchmarks.library [--fk ROWS] [--ik ROWS] [--seconds S]``. Rates per row are the medians of three
runs; set-points and moves go to the same daemon (``contid run finger --mock``) in one run.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from contid import Client, Robot, Sim
from contid.client import ServoState
from contid.remote.protocol.socket_path import is_listening


def seconds(work: Callable[[], object]) -> float:
    """Median of three."""
    spent = []
    for _ in range(3):
        begin_s = time.perf_counter()
        work()
        spent.append(time.perf_counter() - begin_s)
    return statistics.median(spent)


def rows(name: str, fk_rows: int, ik_rows: int) -> None:
    robot = Robot(name)
    low, high = robot.limits.min, robot.limits.max
    rng = np.random.default_rng(19)
    some = rng.uniform(low + 0.3 * (high - low), low + 0.7 * (high - low), (max(fk_rows, ik_rows), len(low)))
    fk_s = seconds(lambda: robot.fk(some[:fk_rows]))
    print(f"{name}: fk {fk_rows} rows in {fk_s:.3f} s, {fk_s / fk_rows * 1e6:.2f} us a row")
    tips = robot.fk(some[:ik_rows]).tip
    answer = robot.ik(tips)
    ik_s = seconds(lambda: robot.ik(tips))
    print(
        f"{name}: ik {ik_rows} rows in {ik_s:.3f} s, {ik_s / ik_rows * 1e6:.2f} us a row, "
        f"{int(answer.converged.sum())} met"
    )


def steps(name: str, count: int) -> None:
    with Sim(name) as sim:
        target = {each: Robot(name)[each].limits.rest for each in sim.names}
        begin_s = time.perf_counter()
        for _ in range(count):
            sim.step(target)
        spent_s = time.perf_counter() - begin_s
        print(
            f"{name}: {count} steps of Sim, {spent_s / count * 1e3:.3f} ms each, "
            f"{count / sim.rate_hz / spent_s:.0f} times real time"
        )


def servo(length_s: float) -> None:
    """Set-points on a line, and the same points as moves."""
    with tempfile.TemporaryDirectory(prefix="contid-") as folder:
        socket = Path(folder) / "s"
        command = [sys.executable, "-m", "contid", "run", "finger", "--mock", "--socket", str(socket)]
        with subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        ) as process:
            while not is_listening(socket):
                time.sleep(0.05)
            with Client(socket) as client:
                while {robot["state"] for robot in client.status()["robots"].values()} != {"HOLD"}:
                    time.sleep(0.05)
                _compare(client, length_s)
            process.terminate()


def _compare(client: Client, length_s: float) -> None:
    client.move({"x_mm": 0.0, "y_mm": 85.0})
    for rate_hz in (50.0, 200.0):

        def controller(state: ServoState) -> Mapping[str, float] | None:
            along = min(state.time_s, length_s)
            return {"x_mm": 4.0 * along, "y_mm": 85.0} if state.time_s < length_s else None

        report = client.servo(rate_hz, controller)
        print(
            f"servo at {rate_hz:g} Hz for {length_s:g} s: {report.steps} set-points, {report.skipped} "
            f"periods skipped, accepted after {report.round_trip_ms:.2f} ms (mean), "
            f"{report.max_round_trip_ms:.1f} (max)"
        )
        client.move({"x_mm": 0.0, "y_mm": 85.0})
    spent = []
    for step in range(40):
        begin_s = time.perf_counter()
        client.move({"x_mm": 0.08 * step, "y_mm": 85.0})
        spent.append(time.perf_counter() - begin_s)
    print(f"move, steps of 0.08 mm: {statistics.median(spent) * 1e3:.0f} ms each (median of {len(spent)})")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fk", type=int, default=100_000)
    parser.add_argument("--ik", type=int, default=1_000_000)
    parser.add_argument("--seconds", type=float, default=4.0)
    given = parser.parse_args()
    print(f"load {os.getloadavg()[0]:.1f}, {len(os.sched_getaffinity(0))} processors")
    rows("cbha", given.fk, given.ik)
    rows("finger", given.fk, given.fk)
    rows("trirack2", given.fk, given.fk // 10)
    rows("stiffflop2", given.fk, given.fk // 10)
    steps("hand", 2000)
    servo(given.seconds)


if __name__ == "__main__":
    main()
