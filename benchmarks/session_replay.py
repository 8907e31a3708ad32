"""How fast a recording replays: ten minutes of the hand at 200 Hz, recorded in virtual time first.

    python -m benchmarks.session_replay [--minutes 10]

Prints wall and processor time of the replay, the time over the recorded time, and the size of the file. The
replay must be bit for bit and take less than a twentieth of the recorded time (30 s for ten minutes).
"""

from __future__ import annotations

import argparse
import io
import math
import sys
import tempfile
import time
from pathlib import Path

from contid.control.engine.cycle import OnEnd
from contid.control.engine.virtual import run_virtual
from contid.control.process.pipe import RunSetup
from contid.robot_file.load import find_robot_file, load_robot_file, with_mock
from contid.session.read import Session
from contid.session.recording_observer import RecordingObserver
from contid.trajectory.read import read_trajectory
from contid_sessions.replay.replay import replay

BAR = 1.0 / 20.0


def circle(minutes: float) -> str:
    """Rows of a circle of 10 mm about (50, 70) mm every 2 s, 50 per second, both fingers."""
    lines = ["t_s,left.x_mm,left.y_mm,right.x_mm,right.y_mm"]
    for row in range(round(minutes * 60 * 50) + 1):
        x, y = 50 + 10 * math.cos(math.pi * row / 50), 70 + 10 * math.sin(math.pi * row / 50)
        lines.append(f"{row / 50!r},{x!r},{y!r},{x!r},{y!r}")
    return "\n".join(lines)


def main() -> int:
    """Record, replay, print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--minutes", type=float, default=10.0)
    minutes = parser.parse_args().minutes
    loaded = with_mock(load_robot_file(find_robot_file("hand")))
    rows = read_trajectory(io.StringIO(circle(minutes)), "circle", loaded.driven)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "hand.mcap"
        start_s = time.perf_counter()
        recording = RecordingObserver(path, {"mock": "True"})
        sink = recording.follow(RunSetup(loaded, 200.0, Path(), rows, OnEnd.STOP, attended=False))
        run_virtual(loaded, 200.0, rows, sinks=[sink], on_end=OnEnd.STOP)
        recording.detach()
        print(f"recorded in virtual time in {time.perf_counter() - start_s:.1f} s")
        session = Session(path)
        start_s, start_cpu_s = time.perf_counter(), time.process_time()
        result = replay(session, session.robot_file())
        took_s, cpu_s = time.perf_counter() - start_s, time.process_time() - start_cpu_s
        recorded_s = result.ticks / 200.0
        size = path.stat().st_size
        print(
            f"{result.ticks} ticks, {recorded_s:.0f} s, replayed in {took_s:.1f} s (processor {cpu_s:.1f} s)"
        )
        print(
            f"{recorded_s / took_s:.0f} times real time; {'equal' if not result.divergence else 'DIFFERENT'}"
        )
        print(f"file: {size / 1e6:.1f} MB, {size / result.ticks:.0f} bytes per tick")
    return 0 if result.divergence is None and took_s < BAR * recorded_s else 1


if __name__ == "__main__":
    sys.exit(main())
