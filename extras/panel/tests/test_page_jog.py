"""The page in a real browser: a slider changes its own coordinate only, from wherever the robot is."""

from __future__ import annotations

import json
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("playwright.sync_api", reason="pip install 'contid[test]'")

from playwright.sync_api import Browser

from contid.remote.protocol.socket_path import is_listening
from tests.support.browser import OpenPage, opened
from tests.support.daemons import Running, armed, command
from tests.support.panels import panel
from tests.support.waiting import until

#: Leases lapse in real time, and the browser shares the cores.
pytestmark = [pytest.mark.process, pytest.mark.realtime]

#: What a coordinate that was not touched may change by [mm].
UNTOUCHED_MM = 1e-6
PRESSES = 6


@contextmanager
def shipped(name: str) -> Iterator[Running]:
    """`contid run NAME --mock`, armed, at rest."""
    folder = Path(tempfile.mkdtemp(prefix="contid-"))
    process = subprocess.Popen(
        command("run", name, "--mock", "--socket", str(folder / "s"), "--recordings", str(folder)),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    running = Running(process, folder / "s", folder)
    try:
        until(lambda: is_listening(running.socket) or process.poll() is not None, "the daemon listens")
        with running.client() as client:
            armed(client)
        yield running
    finally:
        process.kill()
        process.communicate()


class Orders:
    """The rows that a page sends."""

    def __init__(self, it: OpenPage) -> None:
        self.rows: list[list[float]] = []
        it.page.on("websocket", lambda socket: socket.on("framesent", self._take))

    def _take(self, payload: str | bytes) -> None:
        message = json.loads(payload)
        if message["verb"] == "jog":
            self.rows += message["rows"]


def fields(running: Running) -> dict[str, Any]:
    """The newest telemetry of the only robot."""
    with running.client() as client:
        for frame in client.telemetry(50.0, fields=("state", "command", "command_tip_mm")):
            (robot,) = frame["robots"].values()
            return dict(robot)
    raise AssertionError("no telemetry")


@pytest.fixture(params=["tendon3", "ftdcr_v4"])
def at_rest(request: pytest.FixtureRequest, browser: Browser) -> Iterator[tuple[OpenPage, Running, Orders]]:
    with shipped(request.param) as running, panel(running) as served, opened(browser, served) as it:
        orders = Orders(it)
        it.page.reload()
        it.page.wait_for_selector(".robot[data-state=HOLD]")
        it.take_control()
        it.page.wait_for_selector(".robot input:enabled")
        yield it, running, orders


def press(it: OpenPage, slider: Any, key: str) -> None:
    """Press a key several times, as fast as a hand does."""
    slider.focus()
    for _ in range(PRESSES):
        it.page.keyboard.press(key)
        it.page.wait_for_timeout(60)
    it.page.wait_for_timeout(500)


def others_mm(rows: list[list[float]], number: int, start: list[float]) -> float:
    """The greatest change of the coordinates other than one."""
    return max(abs(row[k] - start[k]) for row in rows for k in range(len(start)) if k != number)


def at_standstill(running: Running) -> list[float]:
    """The commanded tip [mm] of a robot that has come to rest."""
    tips: list[list[float]] = [[]]

    def stands() -> bool:
        tips.append(fields(running)["command_tip_mm"])
        return tips[-1] == tips[-2]

    until(stands, "the robot stands")
    return tips[-1]


def test_keys_change_one_coordinate_of_the_tip(at_rest: tuple[OpenPage, Running, Orders]) -> None:
    it, running, orders = at_rest
    start = fields(running)["command_tip_mm"]
    for number, name in enumerate("xy"):
        slider = it.page.locator(f".robot input[aria-label={name}]")
        span = float(slider.get_attribute("max") or 0) - float(slider.get_attribute("min") or 0)
        assert float(slider.get_attribute("max") or 0) >= start[number]
        orders.rows.clear()
        before = at_standstill(running)
        press(it, slider, "ArrowRight")
        assert orders.rows
        assert others_mm(orders.rows, number, before) < UNTOUCHED_MM
        assert 0.0 < max(row[number] for row in orders.rows) - before[number] <= PRESSES * 1e-3 * span + 1e-6
        it.page.wait_for_selector(".robot[data-state=HOLD]")
    z = it.page.locator(".robot input[aria-label=z]")
    low, high = (float(z.get_attribute(name) or "nan") for name in ("min", "max"))
    assert low <= start[2] <= high


def test_keys_change_one_axis(at_rest: tuple[OpenPage, Running, Orders]) -> None:
    it, running, orders = at_rest
    with running.client() as client:
        (robot,) = client.describe()["robots"].values()
    for number in (0, len(robot["axes"]) - 1):
        slider = it.page.locator(".robot fieldset").nth(1).locator("input").nth(number)
        orders.rows.clear()
        before = fields(running)["command"]
        press(it, slider, "ArrowRight")
        assert orders.rows
        assert others_mm(orders.rows, number, before) < UNTOUCHED_MM
        it.page.wait_for_selector(".robot[data-state=HOLD]")


def test_a_mouse_on_a_slider_changes_one_coordinate(at_rest: tuple[OpenPage, Running, Orders]) -> None:
    it, running, orders = at_rest
    before = fields(running)["command_tip_mm"]
    box = it.page.locator(".robot input[aria-label=x]").bounding_box()
    assert box is not None
    middle = box["y"] + box["height"] / 2
    it.page.mouse.move(box["x"] + box["width"] / 2, middle)
    it.page.mouse.down()
    it.page.mouse.move(box["x"] + box["width"] / 2 + 6, middle, steps=4)
    it.page.wait_for_timeout(200)
    it.page.mouse.up()
    it.page.wait_for_timeout(300)
    assert orders.rows
    assert others_mm(orders.rows, 0, before) < UNTOUCHED_MM
