"""The page in a real browser: stops, jogging, faults, leases, and what a frozen page may not do."""

from __future__ import annotations

import io
import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import psutil
import pytest
from matplotlib.image import imread

pytest.importorskip("playwright.sync_api", reason="pip install 'contid[test]'")

from playwright.sync_api import Browser

from tests.support.browser import OpenPage, chromium, opened
from tests.support.command import contid_in
from tests.support.daemons import Running, armed_daemon, command, daemon, states
from tests.support.panels import PanelProcess, panel
from tests.support.waiting import until

#: Leases lapse in real time, and the browser shares the cores.
pytestmark = pytest.mark.realtime

SILENT = "faults:\n  - {at_s: 2.0, for_s: 1.0, kind: silent, axis: f0.left}\n"


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as started:
        yield started


@pytest.fixture
def running() -> Iterator[Running]:
    with armed_daemon(2) as started:
        yield started


@pytest.fixture
def served(running: Running) -> Iterator[PanelProcess]:
    with panel(running) as started:
        yield started


@pytest.fixture
def it(browser: Browser, served: PanelProcess) -> Iterator[OpenPage]:
    with opened(browser, served) as page:
        page.state("f0", "HOLD")
        yield page


def _tip_mm(running: Running, robot: str = "f0") -> list[float]:
    with running.client() as client:
        found: list[float] = client.status()["robots"][robot]["tip_mm"]
    return found


def test_stop_by_click_without_the_lease(it: OpenPage, running: Running) -> None:
    with running.client(name="other") as other:
        other.acquire(30.0)
        it.page.locator("#stop").click()
        it.state("f0", "OFF")
        it.state("f1", "OFF")
    until(running.off, "the devices are without torque")


@pytest.mark.parametrize("focus", ["body", "#stop", ".robot input", ".robot .orders button:nth-child(2)"])
def test_stop_by_the_space_bar_wherever_the_focus_is(it: OpenPage, running: Running, focus: str) -> None:
    it.take_control()
    it.page.locator(focus).first.focus()
    it.page.keyboard.press("Space")
    it.state("f0", "OFF")
    it.page.wait_for_timeout(500)  # a button under the focus must not be pressed by the same key
    until(running.off, "the devices are without torque")
    with running.client() as client:
        assert states(client) == {"OFF"}


def test_stop_when_the_socket_of_the_page_is_lost(it: OpenPage, running: Running) -> None:
    it.page.evaluate("() => { const { WebSocket: W } = window; W.prototype.send = () => {}; }")
    it.page.locator("#stop").click()
    it.state("f0", "OFF")
    until(running.off, "the devices are without torque")


def test_a_stop_that_nothing_confirms_is_reported(it: OpenPage, served: PanelProcess) -> None:
    served.process.kill()
    it.page.locator("#stop").click()
    it.page.wait_for_selector("#alarm:not([hidden])")
    assert "emergency switch" in it.text("#alarm")
    it.page.wait_for_selector("#link[data-state=lost]")
    it.problems.clear()  # the failed requests


@pytest.mark.parametrize("name", ["x", "y", "left", "right"])
def test_jog_along_every_axis(it: OpenPage, running: Running, name: str) -> None:
    slider = it.page.locator(it.slider("f0", name))
    assert slider.is_disabled()
    it.take_control()
    it.page.wait_for_selector(it.slider("f0", name) + ":enabled")
    before, others = it.value("f0", name), _tip_mm(running, "f1")
    slider.focus()
    for _ in range(20):
        it.page.keyboard.press("ArrowLeft")
    until(lambda: it.value("f0", name) < before - 1.9, f"{name} has moved")
    it.state("f0", "HOLD")
    assert _tip_mm(running, "f1") == pytest.approx(others, abs=0.1)


def test_a_jog_out_of_reach_is_refused_with_a_message(it: OpenPage, running: Running) -> None:
    it.take_control()
    slider = it.page.locator(it.slider("f0", "y"))
    box = slider.bounding_box()
    assert box is not None
    middle = box["y"] + box["height"] / 2
    it.page.mouse.move(box["x"] + box["width"] * 0.7, middle)
    it.page.mouse.down()
    it.page.mouse.move(box["x"] + box["width"] - 1, middle, steps=4)
    x_slider = it.page.locator(it.slider("f0", "x"))
    it.page.mouse.up()
    box = x_slider.bounding_box()
    assert box is not None
    it.page.mouse.move(box["x"] + 2, box["y"] + box["height"] / 2)
    it.page.mouse.down()
    it.page.wait_for_function("() => document.querySelector('.refused').textContent.includes('out of reach')")
    it.page.mouse.up()
    it.state("f0", "HOLD")


def test_drag_of_the_target_in_the_view(it: OpenPage, running: Running) -> None:
    it.take_control()
    canvas = it.page.locator("#view").bounding_box()
    assert canvas is not None
    before = _tip_mm(running)
    cursor = "() => document.getElementById('view').style.cursor"
    # Look for the target as a person does: where the pointer becomes a hand.
    grid = [(0.03 * i, 0.05 * k) for k in range(4, 17) for i in range(3, 30)]
    for across, down in grid:
        it.page.mouse.move(canvas["x"] + across * canvas["width"], canvas["y"] + down * canvas["height"])
        if it.page.evaluate(cursor) == "grab":
            break
    else:
        pytest.fail("no target under the pointer")
    it.page.mouse.down()
    it.page.mouse.move(
        canvas["x"] + across * canvas["width"] + 25, canvas["y"] + down * canvas["height"] + 20, steps=8
    )
    it.page.wait_for_timeout(300)
    it.page.mouse.up()
    robot = "f0" if math.dist(_tip_mm(running), before) > 1.0 else "f1"
    it.state(robot, "HOLD")
    with running.client() as client:
        assert states(client) == {"HOLD"}
    if robot == "f1":
        assert _tip_mm(running) == pytest.approx(before, abs=0.1)


def test_the_robots_are_drawn(it: OpenPage) -> None:
    """The first robot is blue, the second orange; in a fault both would be red, without torque grey."""
    assert it.page.locator("#view-note").is_hidden()
    shot = io.BytesIO(it.page.locator("#view").screenshot())
    red, green, blue = np.moveaxis(imread(shot, format="png")[..., :3], -1, 0)
    assert np.count_nonzero((blue > red + 0.35) & (blue > 0.6)) > 500
    assert np.count_nonzero((red > blue + 0.35) & (green > blue + 0.2)) > 500


def test_a_fault_is_explained_and_cleared(browser: Browser) -> None:
    with daemon(options=SILENT) as running, panel(running) as served, opened(browser, served) as it:
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


def test_resume_after_a_stop_of_another_client_asks_first(it: OpenPage, running: Running) -> None:
    with running.client(name="operator") as other:
        other.stop()
        it.page.wait_for_selector(".robot[data-robot=f0][data-stopped-by*=operator]")
        it.page.locator(".robot[data-robot=f0]").get_by_role("button", name="Resume").click()
        assert "operator" in it.text("#confirm")
        it.page.keyboard.press("Escape")


def test_the_daemon_is_killed_and_restarted(it: OpenPage, running: Running) -> None:
    it.take_control()
    running.process.kill()
    running.process.wait()
    it.page.wait_for_selector("#link[data-state=waiting]")
    it.state("f0", "LOST")
    assert "never resumed" in it.text("#view-note")
    again = subprocess.Popen(
        command("run", str(running.folder / "fingers.yaml"), "--socket", str(running.socket), "--disarmed"),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        it.state("f0", "READY")
        it.page.wait_for_selector("#lease[data-mine=false]")
        it.page.wait_for_timeout(1000)
        with running.client() as client:
            assert states(client) == {"READY"}
        it.page.locator("#stop").click()
        it.state("f0", "OFF")
    finally:
        again.terminate()
        again.wait()


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
    before = _tip_mm(running)
    it.page.wait_for_timeout(1000)
    assert _tip_mm(running) == pytest.approx(before, abs=0.2)
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


def test_a_trajectory_is_shown_before_it_is_played(it: OpenPage, running: Running) -> None:
    def upload(name: str, text: str) -> None:
        it.page.set_input_files(
            "#trajectory input", {"name": name, "mimeType": "text/csv", "buffer": text.encode()}
        )

    upload("bad.csv", "t_s,f0.x_mm,f0.y_mm\n0,50,75\n1,9000,75\n")
    it.page.wait_for_selector("#trajectory .bad")
    assert "bad.csv:3" in it.text("#trajectory")
    assert it.page.locator("#trajectory button").is_disabled()
    upload("line.csv", "t_s,f0.x_mm,f0.y_mm\n0,50,75\n0.5,45,75\n1,40,75\n")
    it.page.wait_for_selector("#trajectory .good")
    assert it.page.locator("#trajectory button").is_disabled()
    it.take_control()
    it.page.locator("#trajectory button:enabled").click()
    until(lambda: abs(_tip_mm(running)[0] - 40.0) < 0.5, "the trajectory has ended")


def test_poses_are_saved_and_gone_to(it: OpenPage, running: Running) -> None:
    poses = it.page.locator("#poses")
    assert "None in fingers.poses.yaml yet." in poses.inner_text()
    assert poses.get_by_role("button", name="Save pose").is_disabled()
    start = _tip_mm(running)
    it.take_control()
    it.page.get_by_label("Name of the pose").fill("start")
    it.page.wait_for_selector("#poses [type=submit]:enabled")
    poses.get_by_role("button", name="Save pose").click()
    it.page.wait_for_selector("#poses li")
    assert "contid panel" in (running.folder / "fingers.poses.yaml").read_text()
    with running.client(name="script") as script:
        script.acquire(30.0, takeover=True)
        script.move({"f0.x_mm": start[0] - 8.0, "f0.y_mm": start[1]})
        it.page.wait_for_selector("#lease[data-mine=false]")
        assert poses.get_by_role("button", name="Go to start").is_disabled()
        script.release()
    it.take_control()
    poses.get_by_role("button", name="Go to start").click()
    until(lambda: _tip_mm(running) == pytest.approx(start, abs=0.3), "it is where it was saved")
    # The same name again asks first.
    it.page.get_by_label("Name of the pose").fill("start")
    it.page.keyboard.press("Enter")
    it.page.wait_for_selector("#confirm[open]")
    assert "start" in it.text("#confirm")
    it.page.keyboard.press("Escape")


def test_a_recording_is_begun_and_ended(browser: Browser) -> None:
    with armed_daemon(1) as running, panel(running) as served, opened(browser, served) as it:
        card = it.page.locator("#recording")
        it.page.wait_for_selector("#recording button:enabled")
        assert "Nothing is recorded." in card.inner_text()
        card.get_by_role("button", name="Record").click()
        it.page.wait_for_selector("#recording li.live")
        with running.client() as client:
            (listed,) = client.status()["recordings"]
        assert listed["by"].startswith("panel page")
        assert Path(listed["file"]).name in card.inner_text()
        card.get_by_role("button", name="End recording").click()
        it.page.wait_for_selector("#recording li", state="detached")
        done = contid_in(running.folder, "session", "info", listed["file"])
        assert "clean" in done.stdout, done.stdout + done.stderr


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
