"""Many robots on one live stream through stdin: skipped ticks and their causes, in real time.

``python -m benchmarks.ticks.many_streams [NAME] [COUNT] [SECONDS] [ROWS_HZ]``: copies of the robot of a file
follow a path of 5 % of their ranges in 4 s; its rows come from a process of their own.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final

from benchmarks.scale import many, tips

PATH_S: Final = 4.0
#: Writes the rows of a file again and again, each at its time.
PRODUCER: Final = """
import sys, time
header, *rows = open(sys.argv[1]).read().splitlines()
seconds, hz = map(float, sys.argv[2:])
print(header, flush=True)
begin, row = time.monotonic(), 0
while row < seconds * hz:
    print(rows[row % len(rows)], flush=True)
    row += 1
    time.sleep(max(begin + row / hz - time.monotonic(), 0.0))
"""


def main() -> int:
    name, count, seconds, rows_hz = (*sys.argv[1:], *("finger", "24", "60", "50")[len(sys.argv) - 1 :])
    loaded = many(name, int(count))
    with tempfile.TemporaryDirectory() as folder:
        robots, rows = Path(folder) / "robots.yaml", Path(folder) / "rows.csv"
        robots.write_text(loaded.text)
        # Live rows have no times.
        timed = tips(loaded, PATH_S, float(rows_hz)).splitlines()
        rows.write_text("\n".join(line.partition(",")[2] for line in timed) + "\n")
        produce = [sys.executable, "-c", PRODUCER, str(rows), seconds, rows_hz]
        with subprocess.Popen(produce, stdout=subprocess.PIPE) as producer:
            run = [
                sys.executable,
                "-m",
                "contid",
                "run",
                str(robots),
                "--socket",
                f"{folder}/socket",
                "--json",
            ]
            done = subprocess.run(run, stdin=producer.stdout, stdout=subprocess.PIPE)
    if done.stdout:
        report = json.loads(done.stdout)
        print({key: report[key] for key in ("ticks", "late", "skipped", "longest_gap_ms", "lateness")})
    return done.returncode


if __name__ == "__main__":
    sys.exit(main())
