"""A loop that only sleeps to its deadlines, scheduled as the control process is: how late it wakes up.

``python -m benchmarks.bare_loop SECONDS RATE_HZ`` prints the lateness of every turn [s] as JSON. Beside a
measurement it shows what is due to the machine; the difference to it is due to contid.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time

from contid.control.process.realtime import disable_gc, request_real_time, sleep_until


def lateness_s(seconds: float, rate_hz: float) -> list[float]:
    """How late each turn began [s]; turns that were missed altogether are left out."""
    request_real_time()
    disable_gc()
    late_s: list[float] = []
    base_s, turn = time.monotonic() + 0.01, 0
    while turn < seconds * rate_hz:
        deadline_s = base_s + turn / rate_hz
        late_s.append(sleep_until(deadline_s) - deadline_s)
        turn += 1 + int(late_s[-1] * rate_hz)
    return late_s


def skipped(late_s: list[float], rate_hz: float) -> int:
    """Number of turns that were missed altogether."""
    return sum(int(late * rate_hz) for late in late_s)


def started(seconds: float, rate_hz: float) -> subprocess.Popen[str]:
    """The loop in a process of its own; `read` waits for it."""
    command = [sys.executable, "-m", "benchmarks.bare_loop", str(seconds), str(rate_hz)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def read(process: subprocess.Popen[str]) -> list[float]:
    """The lateness of every turn of a loop that was started [s]."""
    found: list[float] = json.loads(process.communicate(timeout=60.0)[0])
    return found


if __name__ == "__main__":
    print(json.dumps(lateness_s(float(sys.argv[1]), float(sys.argv[2]))))
