"""Start-up times: ``contid --help``, and the first command of ``contid run --mock``.

The bars: help under 0.2 s without numpy, first command under 1 s after the process was started. The first
command is taken from the records of the control process (their deadlines are on CLOCK_MONOTONIC, as is the
start of the process here).

    python benchmarks/startup.py [--runs 5] [--robot hand]
"""

from __future__ import annotations

import argparse
import math
import statistics
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

from contid.control.process.ring import RingError
from contid.control.process.ring_reader import RingReader

HELP_BAR_S = 0.2
COMMAND_BAR_S = 1.0


def help_s() -> float:
    start = time.monotonic()
    subprocess.run([sys.executable, "-m", "contid", "--help"], check=True, stdout=subprocess.DEVNULL)
    return time.monotonic() - start


def floor_s() -> float:
    """What this machine needs just now to start Python with numpy and pydantic: the floor of any start."""
    start = time.monotonic()
    subprocess.run([sys.executable, "-c", "import numpy, pydantic"], check=True)
    return time.monotonic() - start


def heavy_imports() -> list[str]:
    code = (
        "import sys; from contid.cli.main import cli; "
        "print(*sorted({'numpy', 'scipy', 'pydantic', 'rich', 'matplotlib', 'rerun'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    return done.stdout.split()


def first_command_s(robot: str, trajectory: str) -> float:
    """Seconds from the start of the process to the start of the first tick that commands anything."""
    start = time.monotonic()
    process = subprocess.Popen(
        [sys.executable, "-m", "contid", "run", robot, "--mock"],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert process.stdin is not None
    process.stdin.write(trajectory)
    process.stdin.close()
    reader = None
    first = math.nan
    try:
        while math.isnan(first) and process.poll() is None and time.monotonic() - start < 20.0:
            time.sleep(0.005)
            if reader is None:
                for path in Path("/dev/shm").glob(f"contid-{process.pid}-*.ring"):
                    with suppress(RingError):
                        reader = RingReader(path)
                continue
            for record in reader.ticks():
                axes = [axis for each in record.robots for axis in each.axes]
                if not all(math.isnan(axis.device) for axis in axes):
                    first = record.deadline_s + record.lateness_s - start
                    break
    finally:
        if reader is not None:
            reader.close()
        process.terminate()
        process.wait()
    return first


def main() -> int:
    """Print; 1 when a bar was missed."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--runs", type=int, default=5)
    options.add_argument("--robot", default="hand")
    chosen = options.parse_args()
    path = [sys.executable, "-m", "contid", "path", "circle", "--center", "50,70", "--radius", "20"]
    made = subprocess.run([*path, "--for", chosen.robot], check=True, capture_output=True, text=True)
    helps = [help_s() for _ in range(chosen.runs)]
    firsts = [first_command_s(chosen.robot, made.stdout) for _ in range(chosen.runs)]
    floors = [floor_s() for _ in range(chosen.runs)]
    print(f"python with numpy and pydantic, just now: median {statistics.median(floors):.3f} s")
    missed = False
    for what, times, bar in (
        ("contid --help", helps, HELP_BAR_S),
        ("first command of contid run --mock", firsts, COMMAND_BAR_S),
    ):
        median = statistics.median(times)
        met = "met" if median < bar else "MISSED"
        missed |= median >= bar
        print(f"{what}: median {median:.3f} s, worst {max(times):.3f} s of {len(times)} (bar {bar} s: {met})")
    print(f"heavy imports of --help: {', '.join(heavy_imports()) or 'none'}")
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
