"""The page in a real browser: STOP works while the page asks a question, by mouse and by touch."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final

import pytest

pytest.importorskip("playwright.sync_api", reason="pip install 'contid[test]'")

from playwright.sync_api import Browser

from tests.support.browser import OpenPage, opened
from tests.support.daemons import Running, as_started, states
from tests.support.panels import PanelProcess
from tests.support.waiting import until

#: Leases lapse in real time, and the browser shares the cores.
pytestmark = [pytest.mark.process, pytest.mark.realtime]

PHONE: Final[dict[str, Any]] = {"viewport": {"width": 390, "height": 800}, "has_touch": True}
#: A phone on its side: the question and STOP share the little height there is.
FLAT_PHONE: Final[dict[str, Any]] = {"viewport": {"width": 780, "height": 340}, "has_touch": True}
DESKTOP: Final[dict[str, Any]] = {}


@contextmanager
def take_over(it: OpenPage, running: Running) -> Iterator[None]:
    """Another client has the lease, and the page asks whether to take it."""
    with running.client(name="script") as other:
        other.acquire(30.0)
        it.page.get_by_role("button", name="Take over").click()
        yield


@contextmanager
def resume(it: OpenPage, running: Running) -> Iterator[None]:
    """Another client stopped one robot, and the page asks whether to arm it."""
    with running.client(name="script") as other:
        other.stop("f0")
        it.page.wait_for_selector(".robot[data-robot=f0][data-stopped-by*=script]")
        it.page.locator(".robot[data-robot=f0]").get_by_role("button", name="Resume").click()
        yield


@contextmanager
def replace_pose(it: OpenPage, running: Running) -> Iterator[None]:
    """A pose of this name exists, and the page asks whether to replace it."""
    it.take_control()
    it.page.get_by_label("Name of the pose").fill("start")
    it.page.wait_for_selector("#poses [type=submit]:enabled")
    it.page.get_by_role("button", name="Save pose").click()
    it.page.wait_for_selector("#poses li")
    it.page.get_by_label("Name of the pose").fill("start")
    it.page.keyboard.press("Enter")
    yield


QUESTIONS: Final = [take_over, resume, replace_pose]


def stop_button(it: OpenPage) -> tuple[float, float]:
    """The middle of STOP, in the window."""
    x, y = it.page.evaluate(
        """() => {
            const { x, y, width, height } = document.getElementById('stop').getBoundingClientRect();
            return [x + width / 2, y + height / 2];
        }"""
    )
    return float(x), float(y)


def press(it: OpenPage, keys: dict[str, Any]) -> None:
    """Press STOP where it is, as a hand does: whatever lies over it gets the press instead."""
    if keys.get("has_touch"):
        it.page.touchscreen.tap(*stop_button(it))
    else:
        it.page.mouse.click(*stop_button(it))


@pytest.mark.parametrize("keys", [DESKTOP, PHONE, FLAT_PHONE], ids=["mouse", "phone", "flat phone"])
def test_stop_while_the_page_asks(
    browser: Browser, served: PanelProcess, running: Running, keys: dict[str, Any]
) -> None:
    with opened(browser, served, **keys) as it:
        for question in QUESTIONS:
            as_started(running)
            it.state("f1", "HOLD")
            it.page.wait_for_selector("#lease[data-mine=false]")
            _stop_in(question, it, running, keys)


def _stop_in(
    question: Callable[[OpenPage, Running], Any], it: OpenPage, running: Running, keys: dict[str, Any]
) -> None:
    with question(it, running):
        it.page.wait_for_selector("#confirm[open]")
        press(it, keys)
        it.page.wait_for_selector(".robot[data-robot=f1][data-state=OFF]", timeout=5000)
        until(running.off, "the devices are without torque")
        # Who stops does not want what was asked.
        it.page.wait_for_selector("#confirm:not([open])", state="attached", timeout=5000)
        it.page.wait_for_timeout(300)
        with running.client() as client:
            assert not states(client) & {"HOLD", "ARMING"}


def test_a_question_is_answered_by_keys(it: OpenPage, running: Running) -> None:
    """Escape and Enter leave everything as it is; the space bar stops."""
    with take_over(it, running):
        for key in ("Escape", "Enter"):
            it.page.wait_for_selector("#confirm[open]")
            it.page.keyboard.press(key)
            it.page.wait_for_selector("#confirm:not([open])", state="attached", timeout=5000)
            assert it.page.locator("#lease").get_attribute("data-mine") == "false"
            it.page.get_by_role("button", name="Take over").click()
        it.page.keyboard.press("Space")
        it.state("f1", "OFF")
        it.page.wait_for_selector("#confirm:not([open])", state="attached", timeout=5000)


def test_a_second_question_takes_the_place_of_the_first(it: OpenPage, running: Running) -> None:
    """The first one is answered with no: one answer must not do two things."""
    with take_over(it, running):
        it.page.wait_for_selector("#confirm[open]")
        with running.client(name="operator") as other:
            other.stop("f0")
            it.page.wait_for_selector(".robot[data-robot=f0][data-stopped-by*=operator]")
            it.page.locator(".robot[data-robot=f0]").get_by_role("button", name="Resume").click()
            it.page.locator("#confirm").get_by_text("operator").wait_for()
            it.page.locator("#confirm [value=yes]").click()
            it.page.wait_for_selector("#confirm:not([open])", state="attached")
            it.page.wait_for_timeout(500)
            assert it.page.locator("#lease").get_attribute("data-mine") == "false"
