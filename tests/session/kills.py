"""Kills of processes of a run at random times; a campaign is ``python -m tests.session.kills 200``.

The ring of the run is mapped from outside before the kill, so that the number of written ticks
is still readable afterwards.
"""

from __future__ import annotations

import argparse
import collections
import random
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import psutil

from contid.control.process.ring import RingError
from contid.control.process.ring_reader import RingReader
from contid.session.read import Session
from contid_sessions.compact import compact
from contid_sessions.info import summarize
from contid_sessions.replay.replay import replay
from tests.support.fingers import circle_csv, fingers

VICTIMS = ("daemon", "recorder", "control process")
_MODULES = {"recorder": "contid.session.mcap_recorder", "control process": "contid.control.process"}


@dataclass(frozen=True)
class Left:
    """The session after a kill.

    Attributes:
        written: ticks there were; for a killed recorder, until just before the kill.
        recorded: ticks in the session.
        clean: it had its end.
        repaired: ticks in it after a repair.
        replayed: ticks whose commands came out the same, bit for bit.
    """

    written: int
    recorded: int
    clean: bool
    repaired: int
    replayed: int

    @property
    def lost(self) -> int:
        """Missing ticks."""
        return max(self.written - self.recorded, 0)


def kill_one(folder: Path, victim: str, after_s: float) -> Left:
    """Start a recorded run, kill one of its processes, read the session."""
    robot, rows, path = folder / "robot.yaml", folder / "rows.csv", folder / "session.mcap"
    robot.write_text(fingers(2))
    rows.write_text(circle_csv(2, period_s=60.0, rows=600))
    command = [sys.executable, "-m", "contid", "run", str(robot), "--trajectory", str(rows)]
    daemon = subprocess.Popen(
        [*command, "--record", str(path)], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )  # fmt: skip
    others: list[psutil.Process] = []
    ring = None
    try:
        ring = _ring(daemon.pid)
        while ring.written == 0:
            time.sleep(0.005)
        others += psutil.Process(daemon.pid).children()
        time.sleep(after_s)
        chosen = daemon.pid if victim == "daemon" else _child(others, _MODULES[victim])
        written = ring.written
        psutil.Process(chosen).kill()
        if victim == "recorder":
            # The run goes on without its recorder.
            time.sleep(0.05)
            daemon.terminate()
        daemon.wait(20.0)
        psutil.wait_procs(others, timeout=20.0)
        written = written if victim == "recorder" else ring.written
    finally:
        if ring is not None:
            ring.close()
        for process in others:
            if process.is_running():
                process.kill()
        daemon.kill()
        daemon.wait()
    session = Session(path)
    before = summarize(session)
    same = replay(session, session.robot_file())
    whole = Session(compact(path, folder / "repaired.mcap"))
    after = summarize(whole)
    assert whole.end.clean, whole.end.cut
    return Left(
        written, before.ticks, session.end.clean, after.ticks, same.ticks if not same.divergence else -1
    )


def _ring(pid: int) -> RingReader:
    """The ring of a daemon, as soon as it exists."""
    until = time.monotonic() + 20.0
    while time.monotonic() < until:
        for path in Path("/dev/shm").glob(f"contid-{pid}-*.ring"):
            try:
                return RingReader(path)
            except (RingError, ValueError):  # not filled yet
                continue
        time.sleep(0.002)
    raise TimeoutError("no ring")


def _child(processes: list[psutil.Process], module: str) -> int:
    return next(process.pid for process in processes if module in process.cmdline())


def main() -> None:
    """Run a campaign."""
    parser = argparse.ArgumentParser(description="kill -9, many times")
    parser.add_argument("times", type=int)
    parser.add_argument("--victim", choices=VICTIMS, default="daemon")
    parser.add_argument("--seed", type=int, default=1)
    chosen = parser.parse_args()
    moments = random.Random(chosen.seed)
    lost: collections.Counter[int] = collections.Counter()
    wrong = 0
    for number in range(chosen.times):
        with tempfile.TemporaryDirectory() as folder:
            left = kill_one(Path(folder), chosen.victim, moments.uniform(0.0, 1.0))
        lost[left.lost] += 1
        bad = not left.recorded == left.repaired == left.replayed
        wrong += bad
        if bad or left.lost > 1:
            print(f"{number}: {left}", flush=True)
    times = ", ".join(f"{ticks}: {count}" for ticks, count in sorted(lost.items()))
    print(f"{chosen.victim} killed {chosen.times} times; ticks lost: times {{{times}}}; {wrong} wrong")


if __name__ == "__main__":
    main()
