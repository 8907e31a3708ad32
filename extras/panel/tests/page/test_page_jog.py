"""The page in a real browser: a slider changes its own coordinate only, from wherever the robot is."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import pytest

pytest.importorskip("playwright.sync_api", reason="pip install 'contid[test]'")

from playwright.sync_api import Page, WebSocket

from contid.client import Client
from tests.support.browser import OpenPage, Tab
from tests.support.daemons import Running, shipped, states
from tests.support.panels import PanelProcess, panel
from tests.support.waiting import until

#: Leases lapse in real time, and the browser shares the cores.
pytestmark = [pytest.mark.process, pytest.mark.realtime]

#: What a coordinate that was not touched may change by [mm].
UNTOUCHED_MM = 1e-6
#: From the straight pose a tip goes along the surface of its reach, which bends away by the square of the way
#: over twice the length of these arms: less than this [1/mm] times the square.
CURVED_PER_MM = 1.0 / 100.0
PRESSES = 6
#: The rows of half a second of a walk at half speed, of a robot at 0, 0 whose second column has no speed.
WALKED = """async ([refusal, goal]) => {
    const { Walk } = await import('/static/walk.js');
    const rows = [], refusals = new Map(refusal ? [['f0', refusal]] : []);
    const jog = {
        refusals, active: null,
        to(robot, columns, values) { rows.push(values); this.active = robot; refusals.delete(robot); },
        end() { this.active = null; }, ordered() { return null; }, arrived() {},
    };
    const walk = new Walk({}, jog, { share: 0.5 }), columns = ['a', 'b'];
    walk.know(columns, [10, 0], () => [0, 0]);
    walk.to('f0', columns, goal);
    await new Promise((done) => setTimeout(done, 500));
    return [rows, refusals.get('f0') ?? ''];
}"""

#: How far half a second of a walk at a tenth of 100 mm/s goes, whose goal comes anew just after every step.
DRAGGED = """async () => {
    const { Walk } = await import('/static/walk.js');
    let now = 0;
    const every = window.setInterval, clock = performance.now.bind(performance);
    window.setInterval = () => 0;
    performance.now = () => now;
    try {
        const jog = {
            refusals: new Map(), active: null, at: 0,
            to(robot, columns, values) { this.active = robot; this.at = values[0]; },
            end() { this.active = null; }, ordered() { return null; }, arrived() {},
        };
        const walk = new Walk({}, jog, { share: 0.1 }), columns = ['a'];
        walk.know(columns, [100], () => [0]);
        for (let step = 0; step < 10; step++) {
            now += 1;
            walk.to('f0', columns, [50]);
            now += 49;
            walk.step();
        }
        return jog.at;
    } finally {
        window.setInterval = every;
        performance.now = clock;
    }
}"""


def bends(running: Running) -> list[float]:
    """The commanded bends of the only robot."""
    with running.client() as client:
        for frame in client.telemetry(50.0, fields=("bends",)):
            (robot,) = frame["robots"].values()
            return list(robot["bends"])
    raise AssertionError("no telemetry")


class Orders:
    """The rows that a page sends."""

    def __init__(self) -> None:
        self.rows: list[list[float]] = []

    def listen(self, socket: WebSocket) -> None:
        """Take what is sent on a connection."""
        socket.on("framesent", self._take)

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


@dataclass
class Shared:
    """A robot with a panel, and the commands of its axes as it started, straight, by column."""

    running: Running
    served: PanelProcess
    began: dict[str, float]

    def return_to_rest(self) -> None:
        """Make it straight again, if it was moved."""
        with self.running.client(name="next test") as client:
            if commands(client) != self.began:
                client.acquire(20.0, takeover=True)
                client.move(dict.fromkeys(self.began, 0.0))
                client.release()
            until(lambda: states(client) == {"HOLD"}, "the robot holds")


def commands(client: Client) -> dict[str, float]:
    """The command of every axis of the only robot, by its column."""
    ((robot, status),) = client.status()["robots"].items()
    return {f"{robot}.{axis}_mm": values["command_mm"] for axis, values in status["axes"].items()}


@pytest.fixture(scope="module", params=["tendon3", pytest.param("ftdcr_v4", marks=pytest.mark.campaign)])
def shared_robot(request: pytest.FixtureRequest) -> Iterator[Shared]:
    with shipped(request.param) as running, panel(running) as served:
        with running.client() as client:
            began = commands(client)
        yield Shared(running, served, began)


@pytest.fixture
def at_rest(shared_robot: Shared, tab: Tab) -> Iterator[tuple[OpenPage, Running, Orders]]:
    shared_robot.return_to_rest()
    orders = Orders()
    with tab.opened(shared_robot.served, on_websocket=orders.listen) as it:
        it.page.wait_for_selector(".robot[data-state=HOLD]")
        it.take_control()
        it.page.wait_for_selector(".robot input:enabled")
        yield it, shared_robot.running, orders


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
        moved_mm = max(row[number] for row in orders.rows) - before[number]
        assert 0.0 < moved_mm <= PRESSES * 1e-3 * span + 1e-6
        assert others_mm(orders.rows, number, before) < UNTOUCHED_MM + CURVED_PER_MM * moved_mm**2
        it.page.wait_for_selector(".robot[data-state=HOLD]")
    z = it.page.locator(".robot input[aria-label=z]")
    low, high = (float(z.get_attribute(name) or "nan") for name in ("min", "max"))
    assert low <= start[2] <= high


def test_keys_change_one_axis(at_rest: tuple[OpenPage, Running, Orders]) -> None:
    it, running, orders = at_rest
    with running.client() as client:
        (robot,) = client.describe()["robots"].values()
    for number in (0, len(robot["axes"]) - 1):
        slider = it.page.locator(".robot fieldset").nth(2).locator("input[type=range]").nth(number)
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
    moved_mm = max(abs(row[0] - before[0]) for row in orders.rows)
    assert others_mm(orders.rows, 0, before) < UNTOUCHED_MM + CURVED_PER_MM * moved_mm**2


def test_the_first_key_moves_an_arm_at_the_edge_of_its_reach(tab: Tab) -> None:
    with shipped("trirack") as running, panel(running) as served, tab.opened(served) as it:
        it.page.wait_for_selector(".robot[data-state=HOLD]")
        it.take_control()
        it.page.wait_for_selector(".robot input:enabled")
        rest = at_standstill(running)
        for name, number in (("x", 0), ("y", 1)):
            press(it, it.page.locator(f".robot input[aria-label={name}]"), "ArrowRight")
            it.page.wait_for_selector(".robot[data-state=HOLD]")
            assert at_standstill(running)[number] - rest[number] > 0.5
            assert it.page.locator(".robot .refused").inner_text() == ""
        before = bends(running)
        press(it, it.page.locator(".robot input[aria-label='s1.bend']"), "ArrowRight")
        it.page.wait_for_selector(".robot[data-state=HOLD]")
        at_standstill(running)
        after = bends(running)
        assert after[0] > before[0] + 0.1
        assert after[1] == pytest.approx(before[1], abs=1e-4)
        assert before[2] < after[2] < before[2] + 2.0  # at its shortest it grows as it bends
        # Down, out of its reach: the reason stays until something else is ordered.
        for _ in range(2):
            press(it, it.page.locator(".robot input[aria-label=z]"), "PageDown")
        it.page.wait_for_function(
            "document.querySelector('.robot .refused').textContent.includes('out of reach')"
        )
        it.page.wait_for_timeout(800)
        assert "out of reach" in it.page.locator(".robot .refused").inner_text()


@pytest.mark.parametrize("refusal", ["", "a is at the end of its range"])
def test_a_refusal_does_not_hold_what_is_ordered_next(idle: Page, refusal: str) -> None:
    """Below full speed every slider was dead after a refusal, until another button was pressed."""
    rows, left = idle.evaluate(WALKED, [refusal, [1.0, 0.0]])
    assert rows[-1] == [1.0, 0.0]
    assert all(after[0] >= before[0] for before, after in pairwise(rows))
    assert left == ""


def test_a_column_without_a_speed_is_refused_with_its_reason(idle: Page) -> None:
    """As the azimuth of a planar arm: the robot was ordered where it is for ever."""
    rows, left = idle.evaluate(WALKED, ["", [1.0, 5.0]])
    assert rows == []
    assert left.startswith("b has no speed")


def test_a_hand_that_moves_on_is_not_faster_than_the_speed(idle: Page) -> None:
    """Every motion of the hand begins a step anew: 5 mm in half a second, and one step more at most."""
    assert 4.5 <= float(idle.evaluate(DRAGGED)) <= 5.5
