"""The page that the tests visit one after another: whatever a test left there, the next one finds it new."""

from __future__ import annotations

import pytest

pytest.importorskip("playwright.sync_api", reason="pip install 'contid[test]'")

from tests.support.browser import Tab
from tests.support.daemons import Running
from tests.support.panels import PanelProcess
from tests.support.waiting import until

#: Leases lapse in real time, and the browser shares the cores.
pytestmark = [pytest.mark.process, pytest.mark.realtime]

#: What a page has of its visits, and what the next motion of the pointer has of its buttons and keys.
FOUND = """() => {
    const { innerWidth, left, sessionStorage, localStorage } = window;
    window.addEventListener('pointermove', ({ buttons, ctrlKey }) => { window.moved = [buttons, ctrlKey]; });
    const dark = matchMedia('(prefers-color-scheme: dark)').matches;
    return [innerWidth, left ?? null, sessionStorage.length, localStorage.length, document.cookie, dark];
}"""


def test_a_visit_finds_nothing_of_the_one_before(tab: Tab, served: PanelProcess, running: Running) -> None:
    with tab.opened(served) as it:
        it.state("f0", "HOLD")
        new = it.page.evaluate(FOUND)
        it.take_control()
        it.page.locator("#speed input").focus()
        it.page.keyboard.press("ArrowLeft")
        slow = it.text("#speed output")
        it.page.evaluate(
            "() => { window.left = 1; localStorage.setItem('left', '1'); document.cookie = 'left=1'; }"
        )
        it.page.set_viewport_size({"width": 390, "height": 844})
        it.page.emulate_media(color_scheme="dark")
        it.page.mouse.move(200.0, 8.0)
        it.page.mouse.down()
        it.page.keyboard.down("Control")
        it.page.route("**/files/*/faults.js", lambda asked: asked.abort())
        assert it.page.evaluate(FOUND) != new
        it.page.mouse.move(201.0, 8.0)
        assert it.page.evaluate("() => window.moved") == [1, True]
    with running.client() as client:
        until(lambda: client.status()["lease"]["holder"] is None, "the lease is free")
    with tab.opened(served) as it:
        it.state("f0", "HOLD")
        assert it.page.evaluate(FOUND) == new
        it.page.mouse.move(200.0, 8.0)
        assert it.page.evaluate("() => window.moved") == [0, False]
        assert it.text("#speed output") not in ("", slow)
        assert it.page.locator("#lease").get_attribute("data-mine") == "false"
