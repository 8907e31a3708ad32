"""The page in a real browser: the lease of other clients, of frozen, hidden and closed pages; other sites."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import psutil
import pytest

pytest.importorskip("playwright.sync_api", reason="pip install 'contid[test]'")

from playwright.sync_api import Browser

from tests.support.browser import OpenPage, tip_mm
from tests.support.daemons import Running, states
from tests.support.panels import PanelProcess
from tests.support.waiting import until

#: Leases lapse in real time, and the browser shares the cores.
pytestmark = [pytest.mark.process, pytest.mark.realtime]


def test_another_client_takes_the_lease(it: OpenPage, running: Running) -> None:
    it.take_control()
    hostile = '<img src=x onerror="document.body.remove()">'
    with running.client(name=hostile) as other:
        other.acquire(30.0, takeover=True)
        it.page.wait_for_selector("#lease[data-mine=false]")
        assert hostile in it.text("#lease")
        it.page.wait_for_selector(it.slider("f0", "x") + ":disabled")
        it.page.get_by_role("button", name="Take over").click()
        assert hostile in it.text("#confirm")
        it.page.locator("#confirm [value=yes]").click()
        it.page.wait_for_selector("#lease[data-mine=true]")


def _jog_endlessly(it: OpenPage) -> None:
    """A person who drags a slider to and fro and does not let go."""
    it.take_control()
    it.page.wait_for_selector(it.slider("f0", "left") + ":enabled")
    it.page.evaluate(
        """(selector) => {
            const slider = document.querySelector(selector);
            slider.dispatchEvent(new PointerEvent('pointerdown'));
            let k = 0;
            setInterval(() => {
                slider.value = 55 + 25 * Math.sin(k++ / 8);
                slider.dispatchEvent(new Event('input'));
            }, 50);
        }""",
        it.slider("f0", "left"),
    )
    it.page.wait_for_selector(".robot[data-robot=f0]:is([data-state=RUN],[data-state=APPROACH])")


def _renderers(browser: Browser) -> list[psutil.Process]:
    """Renderer processes of the browsers that this test started."""
    mine = psutil.Process().children(recursive=True)
    return [process for process in mine if "--type=renderer" in process.cmdline()]


def test_a_renderer_that_stands_still_loses_the_lease(
    it: OpenPage, running: Running, browser: Browser
) -> None:
    _jog_endlessly(it)
    stopped = _renderers(browser)
    assert stopped
    for process in stopped:
        os.kill(process.pid, signal.SIGSTOP)
    try:
        with running.client() as client:
            until(lambda: client.status()["lease"]["holder"] is None, "the lease has lapsed")
            until(lambda: states(client) == {"HOLD"}, "the robots hold")
    finally:
        for process in stopped:
            os.kill(process.pid, signal.SIGCONT)
    # It goes on dragging, without the lease.
    it.page.wait_for_selector("#lease[data-mine=false]")
    before = tip_mm(running)
    it.page.wait_for_timeout(1000)
    assert tip_mm(running) == pytest.approx(before, abs=0.2)
    with running.client() as client:
        assert states(client) == {"HOLD"}


def test_a_page_that_is_closed_loses_the_lease(it: OpenPage, running: Running) -> None:
    _jog_endlessly(it)
    it.page.close()
    with running.client() as client:
        until(lambda: client.status()["lease"]["holder"] is None, "the lease is free")
        until(lambda: states(client) == {"HOLD"}, "the robots hold")


def test_a_hidden_page_gives_the_lease_back(it: OpenPage, running: Running) -> None:
    _jog_endlessly(it)
    it.page.evaluate(
        """() => {
            Object.defineProperty(document, 'visibilityState', { get: () => 'hidden' });
            document.dispatchEvent(new Event('visibilitychange'));
        }"""
    )
    with running.client() as client:
        until(lambda: client.status()["lease"]["holder"] is None, "the lease is free")
        until(lambda: states(client) == {"HOLD"}, "the robots hold")


def test_a_page_of_another_site_reaches_nothing(
    browser: Browser, served: PanelProcess, running: Running
) -> None:
    """With the port, and even with the token: only the origin is wrong."""
    site = subprocess.Popen(
        [sys.executable, "-m", "http.server", "0", "--bind", "127.0.0.1", "--directory", str(running.folder)],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    assert site.stdout is not None
    try:
        port = site.stdout.readline().split(" port ")[1].split()[0]
        context = browser.new_context()
        page = context.new_page()
        page.goto(f"http://127.0.0.1:{port}/")
        result = page.evaluate(
            """async ([origin, token]) => {
                const failed = (promise) => promise.then((r) => r.type, () => 'failed');
                const simple = await failed(
                    fetch(origin + '/api/estop', { method: 'POST', mode: 'no-cors', body: 'x' }));
                const headers = { Authorization: 'Bearer ' + token };
                const marked = await failed(fetch(origin + '/api/estop', { method: 'POST', headers }));
                const script = await new Promise((resolve) => {
                    const element = document.createElement('script');
                    element.src = origin + '/static/dom.js';
                    element.onload = () => resolve('loaded');
                    element.onerror = () => resolve('failed');
                    document.body.append(element);
                });
                const socket = await new Promise((resolve) => {
                    const address = origin.replace('http', 'ws') + '/socket';
                    const made = new WebSocket(address, ['contid.panel', 'contid.token.' + token]);
                    made.onopen = () => resolve('opened');
                    made.onerror = () => resolve('failed');
                });
                return { simple, marked, script, socket };
            }""",
            [served.origin, served.token],
        )
        context.close()
    finally:
        site.terminate()
        site.communicate()
    assert result["simple"] in ("opaque", "failed")  # sent, refused by the panel, and unreadable
    assert (result["marked"], result["script"], result["socket"]) == ("failed", "failed", "failed")
    with running.client() as client:
        assert states(client) == {"HOLD"}
