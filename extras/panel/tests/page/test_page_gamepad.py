"""The page in a real browser: a gamepad moves the tip while its shoulder button is held, and stops."""

from __future__ import annotations

from typing import Final

import pytest

pytest.importorskip("playwright.sync_api", reason="pip install 'contid[test]'")

from tests.support.browser import OpenPage, tip_mm
from tests.support.daemons import Running
from tests.support.waiting import until

#: Leases lapse in real time, and the browser shares the cores.
pytestmark = [pytest.mark.process, pytest.mark.realtime]

#: A pad in place of the browser's: `pad.axes` and `pad.buttons` are set by the tests.
PAD: Final = """() => {
    const buttons = [...Array(16)].map(() => ({ pressed: false }));
    window.pad = { connected: true, axes: [0, 0, 0, 0], buttons };
    navigator.getGamepads = () => [window.pad];
    window.dispatchEvent(new Event('gamepadconnected'));
}"""


def push(it: OpenPage, held: bool, x: float) -> None:
    it.page.evaluate(
        "([held, x]) => { pad.axes[0] = x; pad.buttons[5].pressed = held; }",
        [held, x],
    )


def test_a_stick_moves_the_tip_only_while_the_shoulder_button_is_held(it: OpenPage, running: Running) -> None:
    it.page.evaluate(PAD)
    it.take_control()
    it.page.wait_for_selector(it.slider("f0", "x") + ":enabled")
    before, other = tip_mm(running), tip_mm(running, "f1")
    push(it, held=False, x=1.0)
    it.page.wait_for_timeout(800)
    assert tip_mm(running) == pytest.approx(before, abs=0.2)
    push(it, held=True, x=0.6)
    until(lambda: tip_mm(running)[0] > before[0] + 3.0, "the tip has moved")
    it.state("f0", "RUN")  # the page has seen it: what it shows next is the end of this motion
    push(it, held=False, x=0.6)
    it.state("f0", "HOLD")
    there = tip_mm(running)
    it.page.wait_for_timeout(800)
    assert tip_mm(running) == pytest.approx(there, abs=0.5)
    assert tip_mm(running, "f1") == pytest.approx(other, abs=0.2)


def test_a_button_of_the_pad_stops_all_robots(it: OpenPage, running: Running) -> None:
    it.page.evaluate(PAD)
    it.page.evaluate("() => { pad.buttons[1].pressed = true; }")
    it.state("f0", "OFF")
    it.state("f1", "OFF")
    until(running.off, "the devices are without torque")
