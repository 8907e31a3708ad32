"""Batches: time of the processor per row for every model, threads, and `contid ik` over a file of rows.

Run from the root of the repository: ``python -m benchmarks.batch``. Postures are drawn evenly from the box of
the limits, targets are their tips, every row starts from the middle of the ranges.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from contid.kinematics.batch import Targets, forward_many, inverse_many
from contid.kinematics.model import Model, build_model
from contid.robot_file.load import load_named
from contid.targets import Target

#: Robot -> rows.
ROBOTS = {"finger": 100_000, "trirack": 100_000, "cbha": 100_000, "trirack2": 10_000, "stiffflop2": 10_000}
CLI_ROWS = 100_000
SINGLE_ROWS = 2000


def model_of(name: str) -> Model:
    (robot,) = load_named(name).file.robots.values()
    return build_model(robot)


def postures(model: Model, rows: int) -> np.ndarray:
    """Inside every limit; a few thousand different ones."""
    low, high = np.array(model.lower), np.array(model.upper)
    cube: np.ndarray = np.random.default_rng(16).random((2000, len(low)))
    drawn = [tuple(row) for row in (low + cube * (high - low)).tolist()]
    inside = np.array([model.inverse(Target(actuation=row), row).actuation for row in drawn])
    return np.resize(inside, (rows, len(low)))


def measure(name: str, rows: int) -> None:
    model = model_of(name)
    actuations = postures(model, rows)
    middle = 0.5 * (np.array(model.lower) + np.array(model.upper))
    forward_many(model, actuations[:1])  # what the first call imports is not counted
    begin = time.process_time()
    tips = forward_many(model, actuations, threads=1)["tip_m"]
    forward_us = (time.process_time() - begin) / rows * 1e6
    targets = Targets.of(tips)
    times = {}
    for threads in (1, 2):
        wall, begin = time.perf_counter(), time.process_time()
        found = inverse_many(model, targets, middle, threads=threads).rows
        times[threads] = (time.perf_counter() - wall, (time.process_time() - begin) / rows * 1e6)
    seed = tuple(middle.tolist())
    singles = [Target(tip_m=tuple(tip)) for tip in tips[:SINGLE_ROWS].tolist()]
    begin = time.process_time()
    for target in singles:
        model.inverse(target, seed)
    single_us = (time.process_time() - begin) / len(singles) * 1e6
    print(
        f"{name:10}  fk {forward_us:6.2f}  ik {times[1][1]:6.2f} us a row; single call {single_us:6.2f} us; "
        f"two threads {times[1][0] / times[2][0]:.2f} times as fast; {found['converged'].mean():.2%} met",
        flush=True,
    )


def command_line() -> None:
    """A smooth way of the CBHA through `contid ik`."""
    model = model_of("cbha")
    low, high = np.array(model.lower), np.array(model.upper)
    rates = np.random.default_rng(16).uniform(0.5, 2.0, len(low))
    way = np.sin(np.linspace(0.0, 200.0, CLI_ROWS)[:, None] * rates)
    tips_mm = forward_many(model, 0.5 * (low + high) + 0.4 * (high - low) * way)["tip_m"] * 1e3
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rows.csv"
        np.savetxt(path, tips_mm, fmt="%.6f", delimiter=",", header="x_mm,y_mm,z_mm", comments="")
        begin = time.perf_counter()
        done = subprocess.run(
            [sys.executable, "-m", "contid", "ik", "cbha", str(path)], capture_output=True, check=True
        )
        spent = time.perf_counter() - begin
    print(f"contid ik cbha: {done.stdout.count(b'true')} of {CLI_ROWS} rows met in {spent:.2f} s")


if __name__ == "__main__":
    for robot, rows in ROBOTS.items():
        measure(robot, rows)
    command_line()
