"""The page in a real browser: numbers that are typed, the speed, and the way to the rest pose."""

from __future__ import annotations

import time

import pytest

pytest.importorskip("playwright.sync_api", reason="pip install 'contid[test]'")

from tests.support.browser import OpenPage, tip_mm
from tests.support.daemons import Running
from tests.support.waiting import until

#: Leases lapse in real time, and the browser shares the cores.
pytestmark = [pytest.mark.process, pytest.mark.realtime]

ENTRY = ".robot[data-robot=f0] input[aria-label='{}, number']"


def typed(it: OpenPage, name: str, text: str, key: str = "Enter") -> None:
    entry = it.page.locator(ENTRY.format(name))
    entry.fill(text)
    entry.press(key)


def in_control(it: OpenPage) -> None:
    it.take_control()
    it.page.wait_for_selector(ENTRY.format("x in mm") + ":enabled")


def set_speed(it: OpenPage, percent: int) -> None:
    it.page.locator("#speed input").focus()
    for _ in range(9):
        if it.text("#speed output") == f"{percent} %":
            return
        it.page.keyboard.press("ArrowLeft")
    raise AssertionError(it.text("#speed output"))


def test_a_typed_number_moves_its_own_coordinate(it: OpenPage, running: Running) -> None:
    in_control(it)
    before, other = tip_mm(running), tip_mm(running, "f1")
    typed(it, "x in mm", "12,5")  # as people in many countries write it
    until(lambda: tip_mm(running)[:2] == pytest.approx([12.5, before[1]], abs=0.6), "the tip is there")
    assert tip_mm(running, "f1") == pytest.approx(other, abs=0.2)
    typed(it, "left in mm", "55")
    it.state("f0", "HOLD")
    with running.client() as client:
        until(
            lambda: client.status()["robots"]["f0"]["axes"]["left"]["command_mm"] == pytest.approx(55.0),
            "the axis is there",
        )


def test_what_was_not_entered_moves_nothing(it: OpenPage, running: Running) -> None:
    in_control(it)
    before = tip_mm(running)
    typed(it, "x in mm", "20", key="Escape")
    typed(it, "y in mm", "60", key="Tab")
    typed(it, "x in mm", "abc")
    it.page.locator(".toast.error").get_by_text("abc is no number").wait_for()
    assert it.page.locator(ENTRY.format("x in mm")).get_attribute("aria-invalid") == "true"
    it.page.wait_for_timeout(800)
    assert tip_mm(running) == pytest.approx(before, abs=0.2)


def test_a_typed_number_out_of_reach_is_refused_with_the_reason(it: OpenPage, running: Running) -> None:
    in_control(it)
    before = tip_mm(running)
    typed(it, "x in mm", "900")
    it.page.locator(".toast.error").wait_for()
    assert "reach" in it.text(".toast.error")
    assert tip_mm(running) == pytest.approx(before, abs=0.2)


def test_the_rest_pose_by_its_button(it: OpenPage, running: Running) -> None:
    in_control(it)
    with running.client() as client:
        typed(it, "left in mm", "50")
        until(
            lambda: client.status()["robots"]["f0"]["axes"]["left"]["command_mm"] == pytest.approx(50.0),
            "it has left its rest pose",
        )
        it.state("f0", "HOLD")
        it.page.locator(".robot[data-robot=f0]").get_by_role("button", name="Rest pose").click()
        # `rest_mm: [60, 60]` of tests.support.fingers
        until(
            lambda: client.status()["robots"]["f0"]["axes"]["left"]["command_mm"] == pytest.approx(60.0),
            "it is at rest",
        )


def test_a_slow_speed_is_slow(it: OpenPage, running: Running) -> None:
    """The racks move at 100 mm/s at most: at 5 % a way of 10 mm takes 2 s and more."""
    in_control(it)
    set_speed(it, 5)
    with running.client() as client:

        def left() -> float:
            return float(client.status()["robots"]["f0"]["axes"]["left"]["command_mm"])

        way_mm = left() - 50.0
        typed(it, "left in mm", "50")
        until(lambda: it.page.locator(".robot[data-state=RUN]").count() > 0, "it moves")
        begun_s = time.monotonic()
        until(lambda: left() == pytest.approx(50.0, abs=0.01), "it is there")
        assert time.monotonic() - begun_s > 0.9 * way_mm / (0.05 * 100.0)


def test_a_slider_at_a_slow_speed_is_followed_slowly_and_stops_with_hold(
    it: OpenPage, running: Running
) -> None:
    in_control(it)
    set_speed(it, 1)
    with running.client() as client:

        def left() -> float:
            return float(client.status()["robots"]["f0"]["axes"]["left"]["command_mm"])

        before = left()
        it.page.locator(it.slider("f0", "left")).focus()
        for _ in range(3):
            it.page.keyboard.press("PageDown")  # 30 mm away, at 1 mm/s
        it.page.wait_for_timeout(2500)
        assert 0.5 < before - left() < 6.0
        it.page.locator(".robot[data-robot=f0]").get_by_role("button", name="Hold", exact=True).click()
        it.page.wait_for_timeout(500)
        stopped = left()
        it.page.wait_for_timeout(1000)
        assert left() == pytest.approx(stopped, abs=0.01)
