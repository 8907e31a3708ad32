"""Presses of STOP before a recorded daemon: by a program or in a browser, and when the ticks obeyed.

A press is timed to the deadline of the first tick whose state is OFF, on the clock of the daemon. In a
browser it has three beginnings: the call of playwright, a process of its own; the event of Chromium, as of a
real mouse; the script of the page.
"""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeAlias

from benchmarks.stop_times import obeyed_after
from contid.client import Client
from contid.control.engine.tick_layout import DEADLINE, LATENESS
from contid.errors import ContidError
from contid.session.read import Session

CHROMIUM: Final = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
#: A loaded machine opens a page slowly; only a hang fails.
TIMEOUT_MS: Final = 300_000.0
#: Until programs that were started run, and pages are quiet.
SETTLE_S: Final = 1.5
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


#: From the socket of a daemon to a button.
Way: TypeAlias = Callable[[Path], AbstractContextManager[Press]]
#: From the socket of a daemon to the URL of a page.
Pages: TypeAlias = Callable[[Path], AbstractContextManager[str]]


@dataclass(frozen=True, slots=True)
class Stops:
    """What was measured.

    Attributes:
        obeyed_s: from the beginning of a press to the tick that obeys, in order of size, by beginning;
            "" is the call.
        late_s: lateness of the ticks meanwhile, in order of size.
        skipped: ticks that were skipped.
    """

    obeyed_s: dict[str, list[float]]
    late_s: list[float]
    skipped: int


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


def executable() -> str:
    """The browser."""
    return os.environ.get("CONTID_CHROMIUM", "/usr/bin/chromium")


@contextmanager
def pressed(url: str, ready: str, stop: str) -> Iterator[Press]:
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


def button(pages: Pages, ready: str, stop: str) -> Way:
    """The button ``stop`` of a page, once ``ready`` is there; both are selectors."""

    @contextmanager
    def way(path: Path) -> Iterator[Press]:
        with pages(path) as url, pressed(url, ready, stop) as press:
            yield press

    return way


def off(client: Client) -> bool:
    """Every robot is OFF."""
    return all(robot["state"] == "OFF" for robot in client.status()["robots"].values())


def presses(path: Path, count: int, press: Press | None) -> list[float]:
    """When each stop began [s]; without a button a client stops."""
    out: list[float] = []
    while len(out) < count:
        with suppress(ContidError), Client(path, name="benchmark", timeout_s=30.0) as client:
            while len(out) < count:
                client.resume(after_stop=True)
                time.sleep(0.1)
                if off(client):  # the request that the page sends beside its socket came after the resume
                    continue
                sent_s = time.monotonic()
                if press is None:
                    client.estop()
                else:
                    press()
                while not off(client):
                    time.sleep(0.002)
                out.append(sent_s)
    return out


def measured(way: Way | None, count: int, crowd: Sequence[Callable[[str], None]] = ()) -> Stops:
    """Press STOP of a new daemon, beside processes that get its socket; a client stops if no way does."""
    with tempfile.TemporaryDirectory(prefix="contid-") as folder, ExitStack() as stack:
        path = stack.enter_context(daemon(Path(folder)))
        press = stack.enter_context(way(path)) if way is not None else None
        context = multiprocessing.get_context("spawn")
        others = [context.Process(target=kind, args=(str(path),), daemon=True) for kind in crowd]
        for each in others:
            each.start()
        time.sleep(SETTLE_S)
        began_s = time.monotonic()
        try:
            sent = presses(path, count, press)
        finally:
            ended_s = time.monotonic()
            for each in others:
                each.kill()
        stages = {"": sent} | (press.stages() if press is not None else {})
        stack.close()
        session = Session(Path(folder, "r.mcap"))
        records = [entry.values for entry in session.entries() if entry.values is not None]
        during = [values for values in records if began_s <= values[DEADLINE] <= ended_s]
        lasted_s = during[-1][DEADLINE] - during[0][DEADLINE]
        return Stops(
            {name: obeyed_after(during, session.layout, began) for name, began in stages.items()},
            sorted(values[LATENESS] for values in during),
            round(lasted_s * session.layout.rate_hz) + 1 - len(during),
        )
