"""How long a press of STOP in the browser takes until a tick obeys it, and what the panel costs the ticks.

``python -m benchmarks.panel_stop [--presses 100]``. A daemon of `contid run hand --mock`, recorded; a panel
with one page in headless Chromium that draws without a graphics card. A press is timed to the deadline of the
first tick whose state is OFF. Between presses a client of its own resumes. Rows: a client without a panel; a
program that speaks to the panel's socket as the page does; the page; the last two again beside two clients
that flood requests and 64 telemetry subscribers at 200 Hz. The page has three rows, by where its time begins:
before playwright, a process of its own, is asked to move the mouse; when Chromium has the press (its time
stamp, as of a real mouse); when the script of the page has it.
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
#: A loaded machine opens a page slowly; only a hang fails.
TIMEOUT_MS: Final = 300_000.0
#: Remembers when Chromium and the script had each press, by the time of day [ms].
WATCH: Final = """(button) => {
    window.pressed = [];
    document.querySelector(button).addEventListener('pointerdown', (event) => {
        const zero = performance.timeOrigin;
        window.pressed.push([zero + event.timeStamp, zero + performance.now()]);
    }, { capture: true });
}"""
#: Questions for the clock of the page, of which the fastest counts.
CLOCK_QUESTIONS: Final = 30


class Press:
    """One way to press STOP; a call presses it.

    Attributes:
        stages: name to times of all presses by `time.monotonic` [s], for stages after the call.
    """

    def __init__(self, press: Callable[[], object]) -> None:
        self._press = press
        self.stages: Callable[[], dict[str, list[float]]] = dict

    def __call__(self) -> None:
        """Press."""
        self._press()


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
        process.wait(120.0)


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
        panel.wait(120.0)


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


@contextmanager
def button(path: Path) -> Iterator[Press]:
    """The STOP of the panel's page in a browser."""
    with served(path) as url, pressed(url, ".robot[data-state=HOLD]") as press:
        yield press


def executable() -> str:
    """The browser."""
    return os.environ.get("CONTID_CHROMIUM", "/usr/bin/chromium")


@contextmanager
def pressed(url: str, ready: str, stop: str = "#stop") -> Iterator[Press]:
    """The button ``stop`` of a page, once ``ready`` is there; both are selectors."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable(), args=list(CHROMIUM))
        page = browser.new_page(viewport={"width": 1280, "height": 860})
        page.set_default_timeout(TIMEOUT_MS)
        page.goto(url)
        page.wait_for_selector(ready)
        page.evaluate(WATCH, stop)
        box = page.locator(stop).bounding_box()
        assert box is not None
        page.mouse.move(box["x"] + 20.0, box["y"] + 20.0)

        def down_and_up() -> None:
            page.mouse.down()
            page.mouse.up()

        def stages() -> dict[str, list[float]]:
            questions = []
            for _ in range(CLOCK_QUESTIONS):
                asked_s = time.monotonic()
                at_ms = page.evaluate("() => performance.timeOrigin + performance.now()")
                answered_s = time.monotonic()
                questions.append((answered_s - asked_s, at_ms / 1e3 - 0.5 * (asked_s + answered_s)))
            behind_s = min(questions)[1]
            times = page.evaluate("() => window.pressed")
            names = "from Chromium's event", "from the script"
            return {name: [each[k] / 1e3 - behind_s for each in times] for k, name in enumerate(names)}

        press = Press(down_and_up)
        press.stages = stages
        yield press
        browser.close()


def presses(path: Path, count: int, press: Press | None) -> list[float]:
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


def measure(name: str, count: int, way: Way | None, crowded: bool) -> list[str]:
    """Rows of the table."""
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
            ended_s = time.monotonic()
            for each in crowd:
                each.kill()
        stages = {"": sent} | (press.stages() if press is not None else {})
        stack.close()
        session = Session(Path(folder, "r.mcap"))
        records = [entry.values for entry in session.entries() if entry.values is not None]
        during = [values for values in records if began_s <= values[DEADLINE] <= ended_s]
        late = sorted(values[LATENESS] for values in during)
        skipped = (
            round((during[-1][DEADLINE] - during[0][DEADLINE]) * session.layout.rate_hz) + 1 - len(during)
        )
        ticks = " | ".join([*cells(late, (0.999, 1.0), 1e6, 0), f"{skipped} of {len(during)}"])
        rows = []
        for stage, began in stages.items():
            obeyed = cells(obeyed_after(during, session.layout, began), (0.5, 0.99, 1.0), 1e3, 1)
            what = f"{name}, {stage}" if stage else name
            rows.append(f"| {what} | {' | '.join(obeyed)} | {ticks if not stage else ' |  | '} |")
        return rows


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
        print("\n".join(measure(name, count, way, crowded)), flush=True)


if __name__ == "__main__":
    main()
