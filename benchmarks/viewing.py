"""Lateness of the tick without a viewer and with one: to a file, to a page, and stopped.

In the case "page, not idle" viewer and server get the priority of every other process, as if contid did not
put them under SCHED_IDLE. ``--ordinary`` withholds real-time priority from the control processes and the bare
loops, as for a user without rights (run it as root).

The cases alternate, so that the load of the machine affects all of them. A bare timer loop under the
same scheduling runs beside each as the baseline of the machine. A viewer's start-up is the time from its
process to its output (the file exists, the page answers); its share of a processor is counted after that,
with the server it starts.

    python -m benchmarks.viewing [--rounds 3] [--seconds 10] [--rate 200] [--robot hand] [--ordinary]
"""

from __future__ import annotations

import argparse
import asyncio
import ctypes
import io
import os
import resource
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import psutil

from benchmarks import bare_loop
from contid.control.daemon.control_child import ControlChild
from contid.control.daemon.daemon import Daemon
from contid.control.daemon.interfaces import RunControl, RunObserver
from contid.control.daemon.run_request import RunOptions
from contid.control.engine.cycle import OnEnd, Sink
from contid.control.engine.messages import Finish, Message
from contid.control.engine.tick_layout import LATENESS
from contid.control.process.pipe import RunSetup
from contid.control.process.ring_reader import RingReader
from contid.robot_file.load import LoadedFile, find_robot_file, load_robot_file, with_mock
from contid.trajectory.read import read_trajectory
from contid.trajectory.timed import Trajectory
from contid_view.observer import ViewerObserver
from contid_view.view_target import Kind, ViewTarget

CASES = ("no viewer", "file", "page", "page, not idle", "stopped")
PR_CAPBSET_DROP, CAP_SYS_NICE = 24, 23
PAGE_PORT = 9090
LOOK_S = 0.02


@dataclass
class Figures:
    """Of one case, over all rounds."""

    late_s: list[float] = field(default_factory=list)
    bare_s: list[float] = field(default_factory=list)
    skipped: int = 0
    bare_skipped: int = 0
    start_s: list[float] = field(default_factory=list)
    share: list[float] = field(default_factory=list)


class Eye:
    """Reads the lateness of every tick, samples the viewer, optionally stops it, and ends the run."""

    def __init__(
        self, viewing: ViewerObserver | None, where: ViewTarget | None, case: str, seconds: float
    ) -> None:
        self.late_s: list[float] = []
        self.start_s: float | None = None
        self.share: float | None = None
        self._viewing, self._where, self._case, self._seconds = viewing, where, case, seconds
        self._reader: RingReader | None = None
        self._began = 0.0

    def attach(self, setup: RunSetup, pid: int) -> None:
        """Open the ring."""
        self._reader = RingReader(setup.ring)
        self._began = time.monotonic()

    def follow(self, setup: RunSetup) -> Sink:
        """Never asked: this benchmark runs in real time."""
        raise RuntimeError("a viewer is measured in real time only")

    def before_order(self, message: Message) -> None:
        """Nothing to do."""

    def detach(self) -> Sequence[str]:
        """Read the last ticks."""
        assert self._reader is not None
        self._read()
        self._reader.close()
        return ()

    async def serve(self, orders: RunControl) -> None:
        """Look at the viewer until the time is over."""
        end, ready, used = time.monotonic() + self._seconds, 0.0, 0.0
        while time.monotonic() < end:
            await asyncio.sleep(LOOK_S)
            self._read()
            if self.start_s is None and self._begun():
                ready, used = time.monotonic(), self._processor_s()
                self.start_s = ready - self._began
                for each in self._family():
                    if self._case == "stopped":
                        each.send_signal(signal.SIGSTOP)
                    elif self._case == "page, not idle":
                        to_ordinary(each)
        if self.start_s is not None:
            self.share = (self._processor_s() - used) / (time.monotonic() - ready)
        orders.send(Finish(reason="on_end"))

    def _read(self) -> None:
        if self._reader is not None:
            self.late_s += [values[LATENESS] for values in self._reader.raw_ticks(1 << 30)]

    def _begun(self) -> bool:
        if self._where is None:
            return False
        if self._where.path is not None:
            return self._where.path.exists()
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", PAGE_PORT)) == 0

    def _family(self) -> list[psutil.Process]:
        pid = None if self._viewing is None else self._viewing.pid
        if pid is None:
            return []
        with suppress(psutil.NoSuchProcess):
            viewer = psutil.Process(pid)
            return [viewer, *viewer.children(recursive=True)]
        return []

    def _processor_s(self) -> float:
        times = [each.cpu_times() for each in self._family()]
        return sum(each.user + each.system for each in times)


def to_ordinary(process: psutil.Process) -> None:
    """Give every thread the policy and the nice value of a program that a shell starts."""
    for thread in process.threads():
        os.sched_setscheduler(thread.id, os.SCHED_OTHER, os.sched_param(0))
        os.setpriority(os.PRIO_PROCESS, thread.id, 0)


def withhold_real_time() -> None:
    """Programs started from now on cannot get real-time priority."""
    if ctypes.CDLL(None, use_errno=True).prctl(PR_CAPBSET_DROP, CAP_SYS_NICE, 0, 0, 0):
        raise SystemExit(f"--ordinary: {os.strerror(ctypes.get_errno())}; run it as root")
    resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))


def one(
    case: str, loaded: LoadedFile, trajectory: Trajectory, rate: float, seconds: float, to: Figures
) -> None:
    """One run of one case."""
    with tempfile.TemporaryDirectory() as folder:
        where = None
        if case != "no viewer":
            page = case.startswith("page")
            where = ViewTarget(Kind.SERVE) if page else ViewTarget(Kind.FILE, Path(folder, "run.rrd"))
        viewing = None if where is None else ViewerObserver(where)
        eye = Eye(viewing, where, case, seconds)
        observers: list[RunObserver] = [eye] if viewing is None else [viewing, eye]
        run = RunOptions(rate_hz=rate, on_end=OnEnd.STOP, commands=[eye], observers=observers)
        bare = bare_loop.started(seconds, rate)
        report = asyncio.run(Daemon(loaded, trajectory, run, ControlChild()).run())
        bare_s = bare_loop.read(bare)
    to.late_s += eye.late_s
    to.skipped += report.skipped
    to.bare_s += bare_s
    to.bare_skipped += bare_loop.skipped(bare_s, rate)
    to.start_s += [] if eye.start_s is None else [eye.start_s]
    to.share += [] if eye.share is None else [eye.share]


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--rounds", type=int, default=3)
    options.add_argument("--seconds", type=float, default=10.0)
    options.add_argument("--rate", type=float, default=200.0)
    options.add_argument("--robot", default="hand")
    options.add_argument("--case", action="append", choices=CASES, help="only this one; can be repeated")
    options.add_argument("--ordinary", action="store_true", help="without real-time priority")
    chosen = options.parse_args()
    if chosen.ordinary:
        withhold_real_time()
    cases = chosen.case or CASES
    loaded = with_mock(load_robot_file(find_robot_file(chosen.robot)))
    path = [sys.executable, "-m", "contid", "path", "circle", "--center", "50,70", "--radius", "20"]
    laps = ["--laps", str(chosen.seconds / 4.0 + 1.0), "--for", chosen.robot]
    made = subprocess.run([*path, *laps], check=True, capture_output=True, text=True)
    trajectory = read_trajectory(io.StringIO(made.stdout), "circle", loaded.driven)
    figures = {case: Figures() for case in cases}
    for _ in range(chosen.rounds):
        for case in cases:
            one(case, loaded, trajectory, chosen.rate, chosen.seconds, figures[case])
    print(
        f"{chosen.robot} at {chosen.rate:g} Hz, {chosen.rounds} rounds of {chosen.seconds:g} s each in turns"
    )
    print(f"load of the machine {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors")
    print(f"{'':22}{'p50':>7}{'p99':>7}{'p99.9':>7}{'max':>8}  skipped   [us]   start [s]   share [%]")
    for case, each in figures.items():
        start = f"{np.median(each.start_s):9.2f}" if each.start_s else ""
        share = f"{100.0 * np.median(each.share):10.1f}" if each.share and case != "stopped" else ""
        for name, late_s, skipped, more in (
            (case, each.late_s, each.skipped, f"{start:>18}{share:>12}"),
            ("  bare loop beside it", each.bare_s, each.bare_skipped, ""),
        ):
            cells = np.quantile(np.array(late_s) * 1e6, [0.5, 0.99, 0.999, 1.0])
            print(
                f"{name:22}"
                + "".join(f"{cell:7.0f}" for cell in cells[:3])
                + f"{cells[3]:8.0f}{skipped:9d}{more}"
            )


if __name__ == "__main__":
    main()
