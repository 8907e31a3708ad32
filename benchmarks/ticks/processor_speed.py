"""How often the machine lowers the clock of its processors, which no waiting shows.

``python -m benchmarks.ticks.processor_speed [SECONDS]``: a loop of known length at real-time priority, 250
times a second, on each processor in turn. A loop that works until a time is over does not see it.
"""

from __future__ import annotations

import os
import sys
import time
from itertools import pairwise
from typing import Final

from contid.control.process.realtime import request_real_time
from contid.control.process.skip_cause import ProcessorSpeed

PERIOD_S: Final = 0.004
#: A processor is slow below this share of its speed; spells nearer than this are one [s].
SLOW: Final = 0.25
TOGETHER_S: Final = 0.7


def look(seconds: float) -> list[tuple[float, float]]:
    """Time and speed of every look."""
    speed, found, due_s = ProcessorSpeed(), [], time.monotonic()
    end_s = due_s + seconds
    while due_s < end_s:
        time.sleep(max(due_s - time.monotonic(), 0.0))
        found.append((time.monotonic(), speed()))
        due_s = max(due_s + PERIOD_S, time.monotonic())
    return found


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 20.0
    if why_not := request_real_time():
        print(why_not, file=sys.stderr)
    for processor in sorted(os.sched_getaffinity(0)):
        os.sched_setaffinity(0, {processor})
        found = look(seconds)
        slow_s = [time_s for time_s, speed in found if speed < SLOW]
        begins_s = [
            now_s
            for before_s, now_s in zip([-1.0, *slow_s], slow_s, strict=False)
            if now_s - before_s > TOGETHER_S
        ]
        gaps = ", ".join(f"{b - a:.2f}" for a, b in pairwise(begins_s))
        print(
            f"processor {processor}: below {SLOW:.0%} of its speed in {len(slow_s) / len(found):.1%} of "
            f"{len(found)} looks, least {min(speed for _, speed in found):.0%}; spells {len(begins_s)}, "
            f"apart [s]: {gaps}"
        )


if __name__ == "__main__":
    main()
