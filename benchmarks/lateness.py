"""Lateness of the tick while the daemon is paused on purpose, with a bare timer loop as baseline.

The daemon runs in this process, exactly as `contid run` runs it, with one more source of commands that blocks
it for 15 ms four times a second. The bare loop is another process that only sleeps to the same deadlines
under the same scheduling: the difference to it is due to contid.

    python benchmarks/lateness.py [--seconds 30] [--rate 200] [--robot hand] [--no-pause]
"""

from __future__ import annotations

import argparse
import asyncio
import io
import json
import subprocess
import sys
import time

from contid.control.daemon.control_child import ControlChild
from contid.control.daemon.daemon import Daemon
from contid.control.daemon.interfaces import RunControl
from contid.control.daemon.run_request import RunOptions
from contid.control.engine.cycle import OnEnd
from contid.control.engine.messages import Finish
from contid.control.engine.wiring import driven_robots
from contid.control.process.realtime import disable_gc, request_real_time, sleep_until
from contid.control.tick.statistics import Lateness
from contid.robot_file.load import load_robot_file, with_mock
from contid.robot_file.shipped import find_robot_file
from contid.trajectory.read import read_trajectory

PAUSE_S = 0.015
PAUSES_PER_S = 4.0


def bare_loop(seconds: float, rate_hz: float) -> None:
    """Print the lateness of a loop that does nothing."""
    request_real_time()
    disable_gc()
    lateness, skipped, tick = Lateness(), 0, 0
    base = time.monotonic() + 0.01
    while tick < seconds * rate_hz:
        late = sleep_until(base + tick / rate_hz) - base - tick / rate_hz
        lateness.add(late)
        skipped += int(late * rate_hz)
        tick += 1 + int(late * rate_hz)
    print(json.dumps({**lateness.as_dict(), "skipped": skipped}))


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
    options.add_argument("--bare", action="store_true", help=argparse.SUPPRESS)
    chosen = options.parse_args()
    if chosen.bare:
        bare_loop(chosen.seconds, chosen.rate)
        return
    child = ControlChild()
    loaded = with_mock(load_robot_file(find_robot_file(chosen.robot)))
    path = [sys.executable, "-m", "contid", "path", "circle", "--center", "50,70", "--radius", "20"]
    laps = ["--laps", str(chosen.seconds / 4.0 + 1.0), "--for", chosen.robot]
    made = subprocess.run([*path, *laps], check=True, capture_output=True, text=True)
    trajectory = read_trajectory(io.StringIO(made.stdout), "circle", driven_robots(loaded))
    pauses = Pauses(chosen.seconds, 0.0 if chosen.no_pause else PAUSE_S)
    run = RunOptions(rate_hz=chosen.rate, on_end=OnEnd.STOP, commands=[pauses])
    bare = subprocess.Popen(
        [sys.executable, __file__, "--bare", "--seconds", str(chosen.seconds), "--rate", str(chosen.rate)],
        stdout=subprocess.PIPE,
        text=True,
    )
    report = asyncio.run(Daemon(loaded, trajectory, run, child).run())
    bare_figures = json.loads(bare.communicate()[0])
    print(f"{chosen.robot} at {chosen.rate:g} Hz for {chosen.seconds:g} s, {pauses.count} pauses of 15 ms")
    print(f"{'':14}{'p50':>8}{'p99':>8}{'p99.9':>8}{'max':>9}  skipped   [us]")
    for name, figures, skipped in (
        ("control tick", report.lateness, report.skipped),
        ("bare loop", bare_figures, bare_figures["skipped"]),
    ):
        cells = [figures[key] for key in ("p50_us", "p99_us", "p99_9_us", "max_us")]
        print(f"{name:14}{cells[0]:8.0f}{cells[1]:8.0f}{cells[2]:8.0f}{cells[3]:9.0f}{skipped:9d}")
    print(f"ticks {report.ticks}, late {report.late}, SCHED_FIFO {'yes' if report.realtime else 'no'}")
    for name, robot in report.robots.items():
        print(f"{name}: tip error max {robot['tip_error_max_mm']:.3g} mm")
    sys.exit(report.exit_code or report.skipped > 0)


if __name__ == "__main__":
    main()
