"""Processor time and memory of `contid adapt`: 2 MB, and a million rows.

``python -m benchmarks.extras.tables [ROWS ...]``. Each size in a process of its own, whose greatest memory is
printed after each step; the robot file is finger, the check is that of `contid check finger TRAJECTORY`.
"""

from __future__ import annotations

import argparse
import multiprocessing
import resource
import tempfile
import time
from pathlib import Path

import numpy as np

from contid_adapt.adapt import check_written, mean
from contid_adapt.reading.read import read_table

MAPPING = "t_s: 1e-3*stamp\nx_mm, y_mm: [1000*x, 1000*y]\nframe: robot\n"


def write(path: Path, rows: int) -> None:
    """A walk of the finger in a thousand steps a second."""
    step = np.arange(rows)
    angle = 2 * np.pi * step / 4000
    table = np.stack([step, 0.02 + 0.005 * np.sin(angle) ** 2, 0.08 + 0.003 * (1 - np.cos(angle))], 1)
    np.savetxt(
        path, table, fmt=["%d", "%.6f", "%.6f"], delimiter=";", header="stamp [ms];x [m];y [m]", comments=""
    )


def measure(path: Path, rows: int) -> None:
    """Print the line of one size."""
    begun_s, parts = time.process_time(), []

    def part(name: str) -> None:
        memory_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        parts.append(f"{name} {time.process_time() - begun_s:.2f} s {memory_mb:.0f} MB")

    part("begun")
    table = read_table(path)
    part("read")
    made = mean(table, "finger", MAPPING)
    part("placed")
    del table
    with path.with_suffix(".csv").open("w+") as written:
        check_written(made, "finger", written)
    part("written and checked")
    print(f"{rows} rows:", ", ".join(parts), flush=True)


def main() -> None:
    """Print a line for each size."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("rows", type=int, nargs="*", default=[85_000, 1_000_000])
    with tempfile.TemporaryDirectory() as folder:
        for rows in parser.parse_args().rows:
            path = Path(folder) / "table.txt"
            write(path, rows)
            print(f"{path.stat().st_size / 1e6:.1f} MB", end=", ", flush=True)
            each = multiprocessing.get_context("spawn").Process(target=measure, args=(path, rows))
            each.start()
            each.join()


if __name__ == "__main__":
    main()
