"""The page in a real browser: STOP, faults, and a daemon that ends."""

from __future__ import annotations

import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

pytest.importorskip("playwright.sync_api", reason="pip install 'contid[test]'")

from tests.support.browser import VIEWPORT, OpenPage, Tab
from tests.support.daemons import Running, as_started, command, daemon, states
from tests.support.panels import PanelProcess, panel
from tests.support.waiting import until

#: Leases lapse in real time, and the browser shares the cores.
pytestmark = [pytest.mark.process, pytest.mark.realtime]

SILENT = "faults:\n  - {at_s: 2.0, for_s: 1.0, kind: silent, axis: f0.left}\n"


@contextmanager
def restarted(running: Running) -> Iterator[None]:
    """The daemon again, at the same socket, after its end; it does not arm."""
    again = subprocess.Popen(
        command("run", str(running.folder / "fingers.yaml"), "--socket", str(running.socket), "--disarmed"),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield
    finally:
        again.terminate()
        again.wait()


def test_stop_by_click_without_the_lease(it: OpenPage, running: Running) -> None:
    with running.client(name="other") as other:
        other.acquire(30.0)
        it.page.locator("#stop").click()
        it.state("f0", "OFF")
        it.state("f1", "OFF")
    until(running.off, "the devices are without torque")


def test_stop_by_the_space_bar_wherever_the_focus_is(it: OpenPage, running: Running) -> None:
    for focus in ("body", "#stop", ".robot input", ".robot .orders button:nth-child(2)"):
        as_started(running)
        it.state("f0", "HOLD")
        it.page.wait_for_selector("#lease[data-mine=false]")
        it.take_control()
        it.page.locator(focus).first.focus()
        it.page.keyboard.press("Space")
        it.state("f0", "OFF")
        it.page.wait_for_timeout(500)  # a button under the focus must not be pressed by the same key
        until(running.off, "the devices are without torque")
        with running.client() as client:
            assert states(client) == {"OFF"}, focus


def test_after_a_stop_no_message_has_that_the_robots_hold(it: OpenPage) -> None:
    """A stop revokes the lease, and torque is off: arms sink."""
    it.take_control()
    it.page.evaluate(
        """() => {
            window.toasts = [];
            new MutationObserver((changes) => {
                for (const { addedNodes } of changes)
                    window.toasts.push(...[...addedNodes].map((n) => n.textContent));
            }).observe(document.getElementById('toasts'), { childList: true });
        }"""
    )
    it.page.locator("#stop").click()
    it.state("f0", "OFF")
    it.page.wait_for_selector("#lease[data-mine=false]")
    it.page.wait_for_timeout(2500)
    toasts = it.page.evaluate("() => window.toasts")
    assert not [text for text in toasts if "hold" in text]
    assert [text for text in toasts if "no torque, it may sink" in text]
    assert "no torque" in it.text(".robot[data-robot=f0] .meaning")


def test_a_lease_that_is_taken_is_shown_with_the_holder(it: OpenPage, running: Running) -> None:
    it.take_control()
    with running.client(name="script") as other:
        other.acquire(30.0, takeover=True)
        it.page.locator(".toast").get_by_text("Control was lost: script has it").wait_for(timeout=8000)


def test_stop_when_the_socket_of_the_page_is_lost(it: OpenPage, running: Running) -> None:
    it.page.evaluate("() => { const { WebSocket: W } = window; W.prototype.send = () => {}; }")
    it.page.locator("#stop").click()
    it.state("f0", "OFF")
    until(running.off, "the devices are without torque")


@pytest.mark.usefixtures("other_panel")
def test_a_stop_that_nothing_confirms_is_reported(it: OpenPage, served: PanelProcess) -> None:
    served.process.kill()
    it.page.locator("#stop").click()
    it.page.wait_for_selector("#alarm:not([hidden])")
    assert "emergency switch" in it.text("#alarm")
    it.page.wait_for_selector("#link[data-state=lost]")
    it.problems.clear()  # the failed requests


def test_a_stop_that_a_hanging_panel_does_not_confirm_is_reported(it: OpenPage, served: PanelProcess) -> None:
    served.process.send_signal(signal.SIGSTOP)
    try:
        it.page.locator("#stop").click()
        it.page.wait_for_selector("#alarm:not([hidden])", timeout=10_000)
    finally:
        served.process.send_signal(signal.SIGCONT)
    it.page.wait_for_selector("#alarm", state="hidden")  # it goes on, and confirms
    it.state("f0", "OFF")


def test_the_alarm_comes_well_within_its_bound(it: OpenPage, served: PanelProcess) -> None:
    """From the press, which waits here for a page that is busy for 0.4 s; 1.5 s are allowed."""
    busy = "() => { const end = performance.now() + 400; while (performance.now() < end); }"
    it.page.evaluate(
        f"""() => {{
            window.addEventListener('pointerdown', {busy}, {{ capture: true, once: true }});
            const timer = window.setTimeout;
            window.setTimeout = (then, ms, ...more) => {{
                if (window.event?.type === 'pointerdown' && ms > 600 && ms < 5000)
                    window.due = performance.now() + ms - window.event.timeStamp;
                return timer(then, ms, ...more);
            }};
        }}"""
    )
    served.process.send_signal(signal.SIGSTOP)
    try:
        it.page.locator("#stop").click()
        it.page.wait_for_selector("#alarm:not([hidden])")
    finally:
        served.process.send_signal(signal.SIGCONT)
    assert it.page.evaluate("() => window.due") == pytest.approx(1200.0, abs=1.0)
    it.page.wait_for_selector("#alarm", state="hidden")


@pytest.mark.usefixtures("other_panel")
def test_the_alarm_is_seen_on_a_phone(it: OpenPage, served: PanelProcess) -> None:
    it.page.set_viewport_size({"width": 390, "height": 800})
    it.page.mouse.wheel(0, 500)
    served.process.kill()
    it.page.locator("#stop").click()
    it.page.wait_for_selector("#alarm:not([hidden])")
    shown = """(alarm) => {
        const { left, top, bottom } = alarm.getBoundingClientRect();
        return [top + 2, bottom - 2].every((y) => document.elementFromPoint(left + 20, y) === alarm);
    }"""
    assert it.page.locator("#alarm").evaluate(shown)
    it.problems.clear()  # the failed requests


def test_a_fault_is_announced_explained_and_cleared(tab: Tab) -> None:
    with daemon(options=SILENT) as running, panel(running) as served, tab.opened(served) as it:
        it.page.set_viewport_size({"width": 390, "height": 600})
        it.page.wait_for_selector("#faults:not([hidden])")
        banner = it.page.get_by_role("alert").filter(has_text="f0: fault 102")
        assert banner.is_visible()
        it.page.mouse.wheel(0, 5000)
        banner.get_by_role("link").click()
        assert it.page.evaluate("document.activeElement.id") == "robot-f0"
        assert it.page.locator(".fault:not([hidden])").is_visible()
        assert served.token in it.page.evaluate("location.hash")  # a reload needs it
        it.page.set_viewport_size(VIEWPORT)
        it.state("f0", "FAULT")
        it.page.wait_for_selector(".fault:not([hidden])")
        text = it.text(".fault")
        for part in ("Fault 102", "f0.left did not answer", "Cause", "Remedy", "docs/faults/102.md"):
            assert part in text
        deadline_s = time.monotonic() + 30.0
        while it.page.locator(".robot[data-state=FAULT]").count() and time.monotonic() < deadline_s:
            it.page.get_by_role("button", name="Clear fault").click()
            it.page.wait_for_timeout(500)
        it.state("f0", "READY")
        it.page.wait_for_selector(".fault", state="hidden")
        it.page.get_by_role("button", name="Resume").click()
        it.state("f0", "HOLD")


def test_resume_after_a_stop_of_another_client_asks_first(it: OpenPage, running: Running) -> None:
    with running.client(name="operator") as other:
        other.stop()
        it.page.wait_for_selector(".robot[data-robot=f0][data-stopped-by*=operator]")
        it.page.locator(".robot[data-robot=f0]").get_by_role("button", name="Resume").click()
        assert "operator" in it.text("#confirm")
        it.page.keyboard.press("Escape")


def test_a_daemon_of_a_changed_file_is_killed_and_restarted(
    drawing_tab: Tab, alone: tuple[Running, PanelProcess]
) -> None:
    running, served = alone
    file = running.folder / "fingers.yaml"
    file.write_text(file.read_text().replace("length_mm: [0, 100]", "length_mm: [0, 90]"))
    with drawing_tab.opened(served) as it:
        it.state("f0", "HOLD")
        it.page.locator("#view-note").get_by_text("has changed since the daemon read it").wait_for()
        it.take_control()
        running.process.kill()
        running.process.wait()
        it.page.wait_for_selector("#link[data-state=waiting]")
        it.state("f0", "LOST")
        assert "never resumed" in it.text("#view-note")
        with restarted(running):
            it.state("f0", "READY")
            it.page.wait_for_selector("#view-note", state="hidden")
            it.page.wait_for_selector("#lease[data-mine=false]")
            it.page.wait_for_timeout(1000)
            with running.client() as client:
                assert states(client) == {"READY"}
            it.page.locator("#stop").click()
            it.state("f0", "OFF")


def test_events_have_their_reasons(it: OpenPage, running: Running) -> None:
    it.page.locator("#stop").click()
    it.state("f0", "OFF")
    it.page.locator("#events li", has_text="f0 OFF").filter(has_text="by STOP on this page").wait_for()
    with running.client(name="operator") as other:
        other.acquire(30.0)
        other.resume()
        it.state("f0", "HOLD")
        it.page.wait_for_timeout(2500)  # longer than an order of this page counts
        other.estop()
    it.page.locator("#events li", has_text="f0 OFF").filter(has_text="stopped by").filter(
        has_text="operator"
    ).wait_for()
