"""The page in a real browser: a press that waits for a panel or page that stands still moves nothing."""

from __future__ import annotations

import signal
import time

import pytest

pytest.importorskip("playwright.sync_api", reason="pip install 'contid[test]'")

from playwright.sync_api import Page

from tests.support.browser import OpenPage
from tests.support.daemons import Running, states
from tests.support.panels import PanelProcess

#: Leases lapse in real time, and the browser shares the cores.
pytestmark = [pytest.mark.process, pytest.mark.realtime]

RESUME = ".robot[data-robot=f0] .orders button:nth-child(2)"
#: A clock with a browser's clock of its own; `message(panel, at)` comes at a time of that.
CLOCKED = """async (work) => {
    const { Clock } = await import('/static/clock.js');
    let now = 0;
    const clock = new Clock(() => now);
    const message = (panel, at) => { now = at; clock.take(panel); };
    return eval(`(() => { ${work} })()`);
}"""


@pytest.fixture
def stopped(it: OpenPage) -> OpenPage:
    """A page that stopped its robots."""
    it.page.locator("#stop").click()
    it.state("f0", "OFF")
    it.page.wait_for_selector(".robot[data-robot=f0]:not([data-stopped-by=''])")
    return it


def asked(it: OpenPage) -> tuple[float, float]:
    """Resume is pressed, and the page asks; the place of the answer that resumes."""
    it.page.locator(RESUME).click()
    box = it.page.locator("#confirm [value=yes]").bounding_box()
    assert box is not None
    return box["x"] + 5, box["y"] + 5


def test_a_resume_pressed_while_the_panel_sleeps(
    stopped: OpenPage, served: PanelProcess, running: Running
) -> None:
    answer = asked(stopped)
    served.process.send_signal(signal.SIGSTOP)
    try:
        stopped.page.mouse.click(*answer)
        time.sleep(3.0)
    finally:
        served.process.send_signal(signal.SIGCONT)
    stopped.page.locator(".toast.error").get_by_text("is not carried out").wait_for(timeout=8000)
    with running.client() as client:
        time.sleep(1.0)
        assert states(client) == {"OFF"}
    stopped.page.mouse.click(*asked(stopped))
    stopped.state("f0", "HOLD")


def test_a_resume_pressed_while_the_page_sleeps(stopped: OpenPage, running: Running) -> None:
    """The press waits for a page whose script stands still; its event has the time of the press."""
    answer = asked(stopped)
    stopped.page.evaluate(
        "() => setTimeout(() => { const end = Date.now() + 3000; while (Date.now() < end); }, 200)"
    )
    time.sleep(0.5)
    stopped.page.mouse.click(*answer)
    stopped.page.locator(".toast.error").get_by_text("is not carried out").wait_for(timeout=8000)
    with running.client() as client:
        assert states(client) == {"OFF"}


@pytest.mark.parametrize(
    ("work", "expected"),
    [
        ("return clock.ofPanel(5)", None),
        # The message that came quickest is right, and none of them is ahead of the panel.
        (
            "message(1e6, 100); message(1e6 + 90, 110); message(1e6 + 100, 300); return clock.ofPanel(310)",
            1000290,
        ),
        # A browser that slept with its clock: the first message corrects it.
        ("message(1e6, 100); message(1e6 + 60000, 200); return clock.ofPanel(201)", 1060001),
        # A browser's clock that runs fast: what was seen long ago does not count.
        ("message(1e6, 0); message(1e6 + 29000, 30000); return clock.ofPanel(30000)", 1029000),
        ("message(1e6, 0); clock.forget(); return clock.ofPanel(1)", None),
    ],
)
def test_the_clock_of_the_panel(idle: Page, work: str, expected: int | None) -> None:
    assert idle.evaluate(CLOCKED, work) == expected
