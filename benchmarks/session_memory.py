"""Memory, processor and disk of a long recording, at an accelerated pace.

    python -m benchmarks.session_memory [--minutes 45] [--speed 10]

The recorder's real process reads a real ring; ``minutes`` of ticks of the hand at 200 Hz are written into it
``speed`` times as fast as a run would (their numbers come from a short recording in virtual time). Prints the
memory that is the recorder's own (the ring is shared) in every tenth of the run, its share of a processor,
what it missed, and the size of the file before and after it was compacted. Memory is flat when the last nine
tenths differ by less than 5 %; nothing may be missed.
"""

from __future__ import annotations

import argparse
import io
import sys
import tempfile
import time
from pathlib import Path

import psutil

from benchmarks.session_replay import circle
from contid.control.engine.cycle import OnEnd
from contid.control.engine.events import RunEvent
from contid.control.engine.tick_layout import DEADLINE, LATENESS, TICK
from contid.control.engine.virtual import run_virtual
from contid.control.engine.wiring import record_layout
from contid.control.process import ring
from contid.control.process.pipe import RunSetup
from contid.control.process.ring_writer import RingWriter
from contid.robot_file.load import find_robot_file, load_robot_file, with_mock
from contid.session.read import Session
from contid.session.recording_observer import RecordingObserver
from contid.trajectory.read import read_trajectory
from contid_sessions.info import summarize

FLAT = 1.05


class Kept:
    """A sink that keeps the records."""

    def __init__(self) -> None:
        self.records: list[list[float]] = []

    def write(self, values: list[float]) -> None:
        """See `contid.control.engine.cycle.Sink`."""
        self.records.append(values)

    def event(self, event: RunEvent) -> None:
        """Events are rare."""


def main() -> int:
    """Write, watch, print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--minutes", type=float, default=45.0)
    parser.add_argument("--speed", type=float, default=10.0)
    chosen = parser.parse_args()
    loaded = with_mock(load_robot_file(find_robot_file("hand")))
    rows = read_trajectory(io.StringIO(circle(0.5)), "circle", loaded.driven)
    kept = Kept()
    run_virtual(loaded, 200.0, rows, sinks=[kept])
    rate_hz, total = 200.0 * chosen.speed, round(chosen.minutes * 60 * 200)
    shared = ring.create(record_layout(loaded, rate_hz))
    writer = RingWriter(shared)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "long.mcap"
        recording = RecordingObserver(path, {"mock": "True"})
        recording.attach(
            RunSetup(loaded, rate_hz, shared, rows, OnEnd.STOP, attended=False), psutil.Process().pid
        )
        recorder = next(
            p for p in psutil.Process().children() if "contid.session.mcap_recorder" in p.cmdline()
        )
        memory: list[int] = []
        base_s, start_cpu = time.monotonic(), sum(recorder.cpu_times()[:2])
        for tick in range(total):
            deadline_s = base_s + tick / rate_hz
            rest_s = deadline_s - time.monotonic()
            if rest_s > 0.0:
                time.sleep(rest_s)
            record = kept.records[tick % len(kept.records)]
            record[TICK], record[DEADLINE], record[LATENESS] = tick, deadline_s, time.monotonic() - deadline_s
            writer.write(record)
            if tick % (total // 10) == total // 10 - 1:
                memory.append(recorder.memory_full_info().uss)
                print(f"{100 * (tick + 1) // total:3d} %: {memory[-1] / 1e6:.1f} MB", flush=True)
        took_s, cpu_s = time.monotonic() - base_s, sum(recorder.cpu_times()[:2]) - start_cpu
        before = path.stat().st_size
        writer.finish()
        start_s = time.monotonic()
        problems = recording.detach()
        closed_s = time.monotonic() - start_s
        after = path.stat().st_size
        info = summarize(Session(path))
    writer.close()
    shared.unlink()
    flat = max(memory[1:]) / min(memory[1:])
    print(f"{info.ticks} ticks ({chosen.minutes:g} min at 200 Hz) in {took_s:.0f} s, {info.lost} missed")
    print(
        f"recorder: {1e6 * cpu_s / total:.0f} us of processor per tick, {2e4 * cpu_s / total:.1f} % at 200 Hz"
    )
    print(f"memory: largest over smallest of the last nine tenths {flat:.3f}")
    print(f"file: {before / 1e6:.0f} MB as it grew, {after / 1e6:.0f} MB compacted, in {closed_s:.1f} s")
    print(f"{info.state}{'; '.join(['', *problems])}")
    return 0 if flat < FLAT and info.lost == 0 and info.ticks == total else 1


if __name__ == "__main__":
    sys.exit(main())
