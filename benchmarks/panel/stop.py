"""How long a press of STOP in the browser takes until a tick obeys it, and what the panel costs the ticks.

``python -m benchmarks.panel.stop [--presses 100]``. A daemon of `contid run hand --mock`, recorded; a panel
with one page in headless Chromium that draws without a graphics card. A press is timed to the deadline of the
first tick whose state is OFF. Between presses a client of its own resumes. Rows: a client without a panel; a
program that speaks to the panel's socket as the page does; the page; the last two again beside two clients
that flood requests and 64 telemetry subscribers at 200 Hz. The page has three rows, by where its time begins:
before playwright, a process of its own, is asked to move the mouse; when Chromium has the press (its time
stamp, as of a real mouse); when the script of the page has it.
"""

from __future__ import annotations

import argparse
import os
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from websockets.typing import Origin, Subprotocol

from benchmarks.on_sigterm import leave_on_sigterm
from benchmarks.panel.presses import Press, Way, button, measured, served
from benchmarks.stop_latency import cheap, subscribes
from benchmarks.stop_times import cells

CROWD: Final[Sequence[Callable[[str], None]]] = (cheap, cheap, subscribes)
PAGE: Final = button(served, ".robot[data-state=HOLD]", "#stop")


@contextmanager
def program(path: Path) -> Iterator[Press]:
    """A program on the panel's WebSocket; a call sends what a press of STOP sends."""
    from websockets.sync.client import connect

    with served(path) as url:
        origin, _, token = url.partition("/#")
        protocols = [Subprotocol("contid.panel"), Subprotocol(f"contid.token.{token}")]
        address = origin.replace("http", "ws") + "/socket"
        with connect(address, origin=Origin(origin), subprotocols=protocols, proxy=None) as page:
            reader = threading.Thread(target=deque, args=(page, 0), daemon=True)
            reader.start()
            yield Press(lambda: page.send('{"id":1,"verb":"estop"}'))


def rows(name: str, count: int, way: Way | None, crowded: bool) -> list[str]:
    """Rows of the table."""
    stops = measured(way, count, CROWD if crowded else ())
    late = cells(stops.late_s, (0.999, 1.0), 1e6, 0)
    ticks = " | ".join([*late, f"{stops.skipped} of {len(stops.late_s) + stops.skipped}"])
    found = []
    for stage, obeyed_s in stops.obeyed_s.items():
        obeyed = cells(obeyed_s, (0.5, 0.99, 1.0), 1e3, 1)
        what = f"{name}, {stage}" if stage else name
        found.append(f"| {what} | {' | '.join(obeyed)} | {ticks if not stage else ' |  | '} |")
    return found


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--presses", type=int, default=100)
    count = parser.parse_args().presses
    print(f"{count} presses each, load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    print("| stop by | obeyed p50 [ms] | p99 | max | ticks late p99.9 [us] | max | skipped |")
    print("|---|---|---|---|---|---|---|")
    ways: tuple[tuple[str, Way | None, bool], ...] = (
        ("client, no panel", None, False), ("program at the panel", program, False), ("page", PAGE, False),
        ("program, flooded", program, True), ("page, flooded", PAGE, True),
    )  # fmt: skip
    for name, way, crowded in ways:
        print("\n".join(rows(name, count, way, crowded)), flush=True)


if __name__ == "__main__":
    leave_on_sigterm()
    main()
