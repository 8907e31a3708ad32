"""Ticks of shipped robots on a live stream: ``python -m benchmarks.ticks.stream_ticks [LOOKS] [ROBOT ...]``.

Processor time of the tick of the robots of a file, without their buses [us], over 2 s of a timed path and the
first 2 s of a live stream of the same motion at 50 rows/s (`contid.control.daemon.measured_run`). Of each
tick the shortest of some looks counts: it does the same in each, and other programs only add to it.
"""

from __future__ import annotations

import sys
from pathlib import Path
from statistics import mean, median
from typing import Final

from contid.control.daemon.measured_run import measured_run
from contid.robot_file.load import LoadedFile, load_named

#: Robot time of a look, and of its parts [s].
LOOK_S: Final = 2.0
PART_S: Final = 0.5


def robot_times(loaded: LoadedFile, virtual_s: float, motion: str, longest_s: float) -> list[float]:
    """Time of the processor that the robots of a file take in each tick of a motion, from its first on [s].

    Args:
        loaded: the robot file; its devices are simulated, at its own rate.
        virtual_s: robot time of the motion.
        motion: of `contid.control.daemon.measured_run.MOTIONS`.
        longest_s: time of measuring.
    """
    with measured_run(loaded, loaded.file.rate_hz, longest_s) as measured:
        return [sum(each.robots_s) for each in measured.ticks(motion, virtual_s)]


def shortest(name: str, motion: str, looks: int) -> list[float]:
    """The shortest time of each tick of a motion [us]."""
    loaded = load_named(name)
    times = [robot_times(loaded, LOOK_S, motion, 60.0) for _ in range(looks)]
    return [1e6 * min(each) for each in zip(*times, strict=True)]


def row(name: str, looks: int) -> str:
    """The row of a robot in the table of docs/benchmarks.md."""
    path, stream = (shortest(name, motion, looks) for motion in ("path", "stream"))
    part = round(PART_S * load_named(name).file.rate_hz)
    parts = [mean(stream[k : k + part]) / mean(path) for k in range(0, len(stream) - part + 1, part)]
    times = (median(path), mean(path), median(stream), mean(stream))
    return f"| {name} | {' | '.join(f'{each:.0f}' for each in times)} | {max(parts):.2f} |"


if __name__ == "__main__":
    given = sys.argv[1:]
    looks = int(given[0]) if given else 5
    robots = given[1:] or sorted(path.stem for path in Path("configs").glob("*.yaml") if "." not in path.stem)
    print("| robot | path, median | mean | stream, median | mean | dearest 0.5 s of the stream / path |")
    print("|---|---|---|---|---|---|")
    for robot in robots:
        print(row(robot, looks), flush=True)
