"""Lateness of the tick while the daemon is paused on purpose, with a bare timer loop as baseline.

The daemon runs in this process, exactly as `contid run` runs it, with one more source of commands that blocks
it for 15 ms four times a second, beside `benchmarks.bare_loop`.

    python -m benchmarks.lateness [--seconds 30] [--rate 200] [--robot hand] [--no-pause]
"""

from __future__ import annotations

import argparse
import asyncio
import io
import subprocess
import sys
import time

from benchmarks import bare_loop
from contid.control.daemon.control_child import ControlChild
from contid.control.daemon.daemon import Daemon
from contid.control.daemon.interfaces import RunControl
from contid.control.daemon.run_request import RunOptions
from contid.control.engine.cycle import OnEnd
from contid.control.engine.messages import Finish
from contid.control.tick.statistics import Lateness
from contid.robot_file.load import find_robot_file, load_robot_file, with_mock
from contid.trajectory.read import read_trajectory

PAUSE_S = 0.015
PAUSES_PER_S = 4.0


class Pauses:
    """A source of commands that gives none and blocks the daemon now and then, then ends the run."""

    def __init__(self, seconds: float, pause_s: float) -> None:
        self.seconds = seconds
        self.pause_s = pause_s
        self.count = 0

    async def serve(self, orders: RunControl) -> None:
        """Pause, and end the run when its time is over."""
        end = time.monotonic() + self.seconds
        while time.monotonic() < end:
            await asyncio.sleep(1.0 / PAUSES_PER_S)
            time.sleep(self.pause_s)  # blocking on purpose: this is the pause
            self.count += self.pause_s > 0.0
        orders.send(Finish(reason="on_end"))


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--seconds", type=float, default=30.0)
    options.add_argument("--rate", type=float, default=200.0)
    options.add_argument("--robot", default="hand")
    options.add_argument("--no-pause", action="store_true")
    chosen = options.parse_args()
    child = ControlChild()
    loaded = with_mock(load_robot_file(find_robot_file(chosen.robot)))
    path = [sys.executable, "-m", "contid", "path", "circle", "--center", "50,70", "--radius", "20"]
    laps = ["--laps", str(chosen.seconds / 4.0 + 1.0), "--for", chosen.robot]
    made = subprocess.run([*path, *laps], check=True, capture_output=True, text=True)
    trajectory = read_trajectory(io.StringIO(made.stdout), "circle", loaded.driven)
    pauses = Pauses(chosen.seconds, 0.0 if chosen.no_pause else PAUSE_S)
    run = RunOptions(rate_hz=chosen.rate, on_end=OnEnd.STOP, commands=[pauses])
    bare = bare_loop.started(chosen.seconds, chosen.rate)
    report = asyncio.run(Daemon(loaded, trajectory, run, child).run())
    bare_late_s, bare_lateness = bare_loop.read(bare), Lateness()
    for late_s in bare_late_s:
        bare_lateness.add(late_s)
    print(f"{chosen.robot} at {chosen.rate:g} Hz for {chosen.seconds:g} s, {pauses.count} pauses of 15 ms")
    print(f"{'':14}{'p50':>8}{'p99':>8}{'p99.9':>8}{'max':>9}  skipped   [us]")
    for name, figures, skipped in (
        ("control tick", report.lateness, report.skipped),
        ("bare loop", bare_lateness.as_dict(), bare_loop.skipped(bare_late_s, chosen.rate)),
    ):
        cells = [figures[key] for key in ("p50_us", "p99_us", "p99_9_us", "max_us")]
        print(f"{name:14}{cells[0]:8.0f}{cells[1]:8.0f}{cells[2]:8.0f}{cells[3]:9.0f}{skipped:9d}")
    print(f"ticks {report.ticks}, late {report.late}, SCHED_FIFO {'yes' if report.realtime else 'no'}")
    for name, robot in report.robots.items():
        print(f"{name}: tip error max {robot['tip_error_max_mm']:.3g} mm")
    sys.exit(report.exit_code or report.skipped > 0)


if __name__ == "__main__":
    main()
