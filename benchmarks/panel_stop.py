"""How long a press of STOP in the browser takes until a tick obeys it, and what the panel costs the ticks.

``python -m benchmarks.panel_stop [--presses 100]``. A daemon of `contid run hand --mock`, recorded; a panel
with one page in headless Chromium that draws without a graphics card. A press is timed from before playwright
sends the mouse event to Chromium (its own way is included) to the deadline of the first tick whose state is
OFF. Between presses a client of its own resumes. Rows: a client without a panel; a program that speaks to the
panel's socket as the page does; the page; the last two again beside two clients that flood requests and as
many telemetry subscribers at 200 Hz as the daemon takes.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Final, TypeAlias

from websockets.typing import Origin, Subprotocol

from benchmarks.stop_latency import cheap, subscribes
from benchmarks.stop_times import cells, obeyed_after
from contid.client import Client
from contid.control.engine.tick_layout import DEADLINE
from contid.errors import ContidError
from contid.session.read import Session

#: Index of the lateness in the values of a record.
LATENESS: Final = 3
CHROMIUM: Final = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
Press: TypeAlias = Callable[[], None]
Way: TypeAlias = Callable[[Path], AbstractContextManager[Press]]
CROWD: Final[Sequence[Callable[[str], None]]] = (cheap, cheap, subscribes)


@contextmanager
def daemon(folder: Path) -> Iterator[Path]:
    """A recorded daemon; its socket."""
    path = folder / "s"
    process = subprocess.Popen(
        [
            *(sys.executable, "-m", "contid", "run", "hand", "--mock", "-q"),
            *("--socket", path, "--record", folder / "r.mcap"),
        ],
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        while not path.exists():
            time.sleep(0.05)
        time.sleep(1.5)
        yield path
    finally:
        process.terminate()
        process.wait(20.0)


@contextmanager
def served(path: Path) -> Iterator[str]:
    """A panel; its URL."""
    panel = subprocess.Popen(
        [sys.executable, "-m", "contid", "panel", "--socket", str(path), "--port", "0"],
        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
    )  # fmt: skip
    assert panel.stdout is not None
    try:
        yield panel.stdout.readline().strip()
    finally:
        panel.terminate()
        panel.wait(20.0)


@contextmanager
def program(path: Path) -> Iterator[Callable[[], None]]:
    """A program on the panel's WebSocket; a call sends what a press of STOP sends."""
    from websockets.sync.client import connect

    with served(path) as url:
        origin, _, token = url.partition("/#")
        protocols = [Subprotocol("contid.panel"), Subprotocol(f"contid.token.{token}")]
        address = origin.replace("http", "ws") + "/socket"
        with connect(address, origin=Origin(origin), subprotocols=protocols, proxy=None) as page:
            reader = threading.Thread(target=deque, args=(page, 0), daemon=True)
            reader.start()
            yield lambda: page.send('{"id":1,"verb":"estop"}')


@contextmanager
def button(path: Path) -> Iterator[Callable[[], None]]:
    """The STOP of a page in a browser; a call presses it."""
    from playwright.sync_api import sync_playwright

    with served(path) as url, sync_playwright() as playwright:
        executable = os.environ.get("CONTID_CHROMIUM", "/usr/bin/chromium")
        browser = playwright.chromium.launch(executable_path=executable, args=list(CHROMIUM))
        page = browser.new_page(viewport={"width": 1280, "height": 860})
        page.goto(url)
        page.wait_for_selector(".robot[data-state=HOLD]")
        box = page.locator("#stop").bounding_box()
        assert box is not None
        page.mouse.move(box["x"] + 20.0, box["y"] + 20.0)

        def press() -> None:
            page.mouse.down()
            page.mouse.up()

        yield press
        browser.close()


def presses(path: Path, count: int, press: Callable[[], None] | None) -> list[float]:
    """When each stop began [s]; without a button a client stops."""
    out: list[float] = []
    while len(out) < count:
        with suppress(ContidError), Client(path, name="benchmark", timeout_s=30.0) as client:
            while len(out) < count:
                client.resume(after_stop=True)
                time.sleep(0.1)
                sent_s = time.monotonic()
                if press is None:
                    client.estop()
                else:
                    press()
                while any(robot["state"] != "OFF" for robot in client.status()["robots"].values()):
                    time.sleep(0.002)
                out.append(sent_s)
    return out


def measure(name: str, count: int, way: Way | None, crowded: bool) -> str:
    """One row of the table."""
    with tempfile.TemporaryDirectory(prefix="contid-") as folder, ExitStack() as stack:
        path = stack.enter_context(daemon(Path(folder)))
        press = stack.enter_context(way(path)) if way is not None else None
        context = multiprocessing.get_context("spawn")
        crowd = (
            [context.Process(target=kind, args=(str(path),), daemon=True) for kind in CROWD]
            if crowded
            else []
        )
        for each in crowd:
            each.start()
        time.sleep(1.5)
        began_s = time.monotonic()
        try:
            sent = presses(path, count, press)
        finally:
            for each in crowd:
                each.kill()
        ended_s = time.monotonic()
        stack.close()
        session = Session(Path(folder, "r.mcap"))
        records = [entry.values for entry in session.entries() if entry.values is not None]
        during = [values for values in records if began_s <= values[DEADLINE] <= ended_s]
        obeyed = obeyed_after(during, session.layout, sent)
        late = sorted(values[LATENESS] for values in during)
        row = [*cells(obeyed, (0.5, 0.99, 1.0), 1e3, 1), *cells(late, (0.999, 1.0), 1e6, 0)]
        skipped = (
            round((during[-1][DEADLINE] - during[0][DEADLINE]) * session.layout.rate_hz) + 1 - len(during)
        )
        return f"| {name} | {' | '.join(row)} | {skipped} of {len(during)} |"


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
    rows: tuple[tuple[str, Way | None, bool], ...] = (
        ("client, no panel", None, False), ("program at the panel", program, False), ("page", button, False),
        ("program, flooded", program, True), ("page, flooded", button, True),
    )  # fmt: skip
    for name, way, crowded in rows:
        print(measure(name, count, way, crowded), flush=True)


if __name__ == "__main__":
    main()
