"""The page in a real browser: STOP in random states of the page is carried out or alarmed within 1.5 s.

A trial puts the page into a state (a question open, a number half typed, a slider under a finger, a hidden
tab that comes back, a robot on its way), disturbs what is between it and the robots (panel or daemon that
stands still, a socket or requests that lead nowhere, a page that is busy) and presses STOP, by mouse, touch
or the space bar. The page's own clock measures from the press, by the time of its event, to the first of
both: all robots shown as off, or the alarm. What is shown as off is then asked of the devices.
`CONTID_STOPS=1000` gives the length of the campaign, `CONTID_SEED` its numbers. Of a trial that fails, what
the page showed and when, a screenshot, its text, the journal of the devices and the error stay in the folder
`CONTID_STOPS_KEEP`, else in the temporary folder of the test; the campaign goes on.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, Final

import pytest

pytest.importorskip("playwright.sync_api", reason="pip install 'contid[test]'")

from playwright.sync_api import Browser

from tests.support.browser import OpenPage, opened
from tests.support.daemons import FAR, Running, armed_daemon
from tests.support.panels import PanelProcess, panel
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime, pytest.mark.campaign]

STOPS: Final = int(os.environ.get("CONTID_STOPS", "30"))
SEED: Final = int(os.environ.get("CONTID_SEED", STOPS))
#: Failed trials after which a campaign ends.
MOST_WRONG: Final = 10
#: What the issue allows [ms].
WITHIN_MS = 1500.0
PHONE: Final[dict[str, Any]] = {"viewport": {"width": 390, "height": 800}, "has_touch": True}
DESKTOP: Final[dict[str, Any]] = {}
#: Measures from the press to what the page shows of it; listens first, as STOP of the page ends the event.
WATCH: Final = """(() => {
    const seen = (window.watched = { pressed: null, off: null, alarm: null });
    const press = (event) => {
        const isStop = event.type === 'keydown' ? event.key === ' ' : event.target.closest?.('#stop');
        if (isStop && seen.pressed === null) seen.pressed = event.timeStamp;
    };
    for (const kind of ['pointerdown', 'keydown']) window.addEventListener(kind, press, true);
    window.trail = []; // what was shown, and when [ms]
    window.rearm = () => {
        Object.assign(seen, { pressed: null, off: null, alarm: null });
        window.trail.length = 0;
    };
    const look = () => {
        const states = [...document.querySelectorAll('.robot')].map((each) => each.dataset.state).join();
        const alarm = document.getElementById('alarm')?.textContent;
        const link = document.getElementById('link')?.dataset.state;
        const shown = [states, link, alarm, document.querySelector('dialog[open]')?.id, seen.pressed];
        if (JSON.stringify(shown) !== JSON.stringify(window.trail.at(-1)?.slice(1)))
            window.trail.push([performance.now(), ...shown]);
        if (seen.pressed !== null) {
            const robots = [...document.querySelectorAll('.robot')];
            if (robots.every((each) => each.dataset.state === 'OFF')) seen.off ??= performance.now();
            if (!document.getElementById('alarm').hidden) seen.alarm ??= performance.now();
        }
    };
    new MutationObserver(look).observe(document,
        { subtree: true, attributes: true, attributeFilter: ['data-state', 'hidden', 'open'] });
})()"""
#: Ways of the page that lead nowhere; `window.repair` undoes it.
MUTE_SOCKET: Final = """() => {
    const send = WebSocket.prototype.send;
    WebSocket.prototype.send = () => {};
    window.repair = () => { WebSocket.prototype.send = send; };
}"""
MUTE_REQUESTS: Final = """() => {
    const fetch = window.fetch;
    window.fetch = () => new Promise(() => {});
    window.repair = () => { window.fetch = fetch; };
}"""
BUSY: Final = "() => setTimeout(() => { const end = Date.now() + 400; while (Date.now() < end); }, 0)"
HIDDEN: Final = """(state) => {
    Object.defineProperty(document, 'visibilityState', { get: () => state, configurable: true });
    document.dispatchEvent(new Event('visibilitychange'));
}"""


class Trial:
    """One page, its panel and its daemon."""

    def __init__(self, it: OpenPage, served: PanelProcess, running: Running, *, touches: bool) -> None:
        self.it, self.served, self.running, self.touches = it, served, running, touches

    def ready(self) -> None:
        """Both robots hold, and the page has nothing open."""
        it = self.it
        it.page.keyboard.press("Escape")
        with self.running.client(name="lab") as lab:
            lab.acquire(5.0, takeover=True)
            lab.resume(after_stop=True)
            lab.release()
        for robot in ("f0", "f1"):
            it.state(robot, "HOLD")
        # A page that still shows `lab` as the holder asks whether to take over.
        it.page.wait_for_selector("#lease[data-free=true]")
        it.page.wait_for_selector("#alarm", state="hidden")
        it.page.evaluate("() => { window.scrollTo(0, 0); document.activeElement?.blur(); window.rearm(); }")

    # States of the page.

    def idle(self) -> Iterator[None]:
        yield

    def in_control(self) -> Iterator[None]:
        self.it.take_control()
        yield

    def take_over(self) -> Iterator[None]:
        with self.running.client(name="script") as other:
            other.acquire(30.0)
            self.it.page.get_by_role("button", name="Take over").click()
            self.it.page.wait_for_selector("#confirm[open]")
            yield

    def half_typed(self) -> Iterator[None]:
        self.it.take_control()
        entry = self.it.page.locator(".robot[data-robot=f0] input.entry").first
        entry.fill("4")
        yield

    def pose_named(self) -> Iterator[None]:
        self.it.take_control()
        self.it.page.get_by_label("Name of the pose").fill("a pose")
        yield

    def scrolled(self) -> Iterator[None]:
        self.it.page.evaluate("() => window.scrollTo(0, document.body.scrollHeight)")
        yield

    def slider_held(self) -> Iterator[None]:
        self.it.take_control()
        slider = self.it.page.locator(".robot[data-robot=f1] input[type=range]:enabled").last
        slider.focus()
        for _ in range(3):
            self.it.page.keyboard.press("ArrowRight")
        yield

    def on_its_way(self) -> Iterator[None]:
        with self.running.client(name="script") as other:
            other.acquire(30.0)
            other.move({f"f0.{name}": value for name, value in FAR.items()}, wait=False)
            yield
        with self.running.client(name="script") as other:
            other.acquire(5.0, takeover=True)
            other.release()

    def was_hidden(self) -> Iterator[None]:
        self.it.take_control()
        self.it.page.evaluate(HIDDEN, "hidden")
        self.it.page.wait_for_timeout(300)
        self.it.page.evaluate(HIDDEN, "visible")
        yield

    def is_hidden(self) -> Iterator[None]:
        """What a screen reader or a keyboard shortcut of the system still reaches."""
        self.it.page.evaluate(HIDDEN, "hidden")
        yield
        self.it.page.evaluate(HIDDEN, "visible")

    # What is between the page and the robots.

    def nothing(self) -> Iterator[None]:
        yield

    def panel_stands(self) -> Iterator[None]:
        self.served.process.send_signal(signal.SIGSTOP)
        try:
            yield
        finally:
            self.served.process.send_signal(signal.SIGCONT)

    def daemon_stands(self) -> Iterator[None]:
        self.running.process.send_signal(signal.SIGSTOP)
        try:
            yield
        finally:
            self.running.process.send_signal(signal.SIGCONT)

    def mute_socket(self) -> Iterator[None]:
        self.it.page.evaluate(MUTE_SOCKET)
        yield
        self.it.page.evaluate("() => window.repair()")

    def mute_requests(self) -> Iterator[None]:
        self.it.page.evaluate(MUTE_REQUESTS)
        yield
        self.it.page.evaluate("() => window.repair()")

    def busy(self) -> Iterator[None]:
        self.it.page.evaluate(BUSY)
        yield

    def press(self, by_key: bool) -> None:
        """Where STOP is: whatever lies over it gets the press instead."""
        if by_key:
            self.it.page.keyboard.press("Space")
            return
        x, y, width, height = self.it.page.locator("#stop").evaluate(
            "(e) => { const r = e.getBoundingClientRect(); return [r.x, r.y, r.width, r.height]; }"
        )
        there = (x + width / 2, y + height / 2)
        (self.it.page.touchscreen.tap if self.touches else self.it.page.mouse.click)(*there)

    def result(self) -> dict[str, float | None]:
        """What the page showed, and when."""
        self.it.page.wait_for_function(
            "() => watched.pressed !== null && (watched.off !== null || watched.alarm !== null)", timeout=8000
        )
        found: dict[str, float | None] = self.it.page.evaluate("() => watched")
        return found


STATES: Final = (
    Trial.idle, Trial.in_control, Trial.take_over, Trial.half_typed, Trial.pose_named, Trial.scrolled,
    Trial.slider_held, Trial.on_its_way, Trial.was_hidden, Trial.is_hidden,
)  # fmt: skip
BETWEEN: Final = (
    Trial.nothing, Trial.nothing, Trial.nothing, Trial.panel_stands, Trial.daemon_stands, Trial.mute_socket,
    Trial.mute_requests, Trial.busy,
)  # fmt: skip

Part = Callable[[Trial], Iterator[None]]


def keep(trial: Trial, folder: Path, what: str) -> None:
    """What is left of a trial that failed; the page starts again, as does what was stopped."""
    folder.mkdir(parents=True)
    (folder / "what.txt").write_text(f"{what}\nload {os.getloadavg()}\n{traceback.format_exc()}")
    for process in (trial.served.process, trial.running.process):
        with suppress(ProcessLookupError):
            process.send_signal(signal.SIGCONT)
    page = trial.it.page
    with suppress(Exception):
        shown = page.evaluate("() => ({ now: performance.now(), watched, trail })")
        (folder / "shown.json").write_text(json.dumps(shown, indent=1))
        (folder / "page.html").write_text(page.content())
        page.screenshot(path=folder / "page.png", timeout=10_000)
    (folder / "console.txt").write_text("\n".join(trial.it.problems))
    with suppress(OSError):
        shutil.copy(trial.running.folder / "journal.jsonl", folder)
    with suppress(Exception), trial.running.client() as client:
        (folder / "status.json").write_text(json.dumps(client.status(), indent=1, default=str))
    page.reload()


def tried(trial: Trial, state: Part, between: Part, *, by_key: bool) -> tuple[str, float]:
    """One press; how it ended ("off" or "alarm") and after how many ms."""
    trial.ready()
    with ExitStack() as stack:
        stack.enter_context(contextmanager(state)(trial))
        with contextmanager(between)(trial):
            trial.press(by_key)
            seen = trial.result()
        ends = {name: seen[name] for name in ("off", "alarm") if seen[name] is not None}
        end = min(ends, key=lambda name: float(ends[name] or 0.0))
        if end == "off":
            assert trial.running.off(), "shown as off while the devices have torque"
        else:
            until(trial.running.off, "the devices are without torque after the alarm")
    return end, float(ends[end] or 0.0) - float(seen["pressed"] or 0.0)


@pytest.mark.timeout(7200)
def test_stop_in_every_state_of_the_page(browser: Browser, tmp_path: Path) -> None:
    numbers = random.Random(SEED)
    kept = Path(os.environ.get("CONTID_STOPS_KEEP", tmp_path))
    wrong, ended, worst = [], Counter[str](), dict[str, float]()
    with ExitStack() as stack:
        running = stack.enter_context(armed_daemon(2, rate_hz=50))
        served = stack.enter_context(panel(running))
        trials = []
        for keys in (DESKTOP, PHONE):
            it = stack.enter_context(opened(browser, served, **keys))
            it.page.add_init_script(WATCH)
            it.page.reload()
            it.state("f1", "HOLD")
            trials.append(Trial(it, served, running, touches=keys is PHONE))
        for number in range(STOPS):
            trial = numbers.choice(trials)
            state, between = STATES[number % len(STATES)], numbers.choice(BETWEEN)
            by_key = not trial.touches and numbers.random() < 0.4
            way = "touch" if trial.touches else "space" if by_key else "mouse"
            what = f"{state.__name__}, {between.__name__}, {way}"
            try:
                end, after_ms = tried(trial, state, between, by_key=by_key)
            except Exception as error:
                wrong.append(f"{number}: {what}: {str(error).splitlines()[0]}")
                keep(trial, kept / str(number), what)
                if len(wrong) >= MOST_WRONG:
                    break
                continue
            ended[end] += 1
            worst[end] = max(worst.get(end, 0.0), after_ms)
            if after_ms > WITHIN_MS:
                wrong.append(f"{number}: {what}: {end} after {after_ms:.0f} ms")
                keep(trial, kept / str(number), what)
            if number % 10 == 9:
                print(f"{number + 1}: {dict(ended)}, at the latest after {worst} ms, {wrong}", flush=True)
        for each in trials:
            each.it.problems.clear()  # requests that failed while the panel stood still
    print(f"{dict(ended)}, at the latest after {worst} ms")
    assert wrong == []
