"""The page in a real browser: what plots show, and how a hand moves through the last minutes."""

from __future__ import annotations

import itertools
import re
from pathlib import Path
from typing import Final

import pytest

pytest.importorskip("playwright.sync_api", reason="pip install 'contid[test]'")

from tests.support.browser import OpenPage
from tests.support.daemons import Running
from tests.support.waiting import until

#: Leases lapse in real time, and the browser shares the cores.
pytestmark = [pytest.mark.process, pytest.mark.realtime]

CSS: Final = Path(__file__).parents[2] / "contid_panel/static/panel.css"
#: Least distance in CIELAB (1976) of two colours, and least contrast with the card (WCAG 2.2, 1.4.11).
DISTANCE: Final = 20.0
CONTRAST: Final = 3.0


def linear(colour: str) -> list[float]:
    """Red, green, blue of sRGB, linear (IEC 61966-2-1)."""
    values = [int(colour[k : k + 2], 16) / 255.0 for k in (1, 3, 5)]
    return [v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in values]


def lab(colour: str) -> list[float]:
    """CIELAB with D65."""
    r, g, b = linear(colour)
    xyz = (
        (0.4124 * r + 0.3576 * g + 0.1805 * b) / 0.95047,
        0.2126 * r + 0.7152 * g + 0.0722 * b,
        (0.0193 * r + 0.1192 * g + 0.9505 * b) / 1.08883,
    )
    x, y, z = (v ** (1 / 3) if v > 0.008856 else 7.787 * v + 16 / 116 for v in xyz)
    return [116 * y - 16, 500 * (x - y), 200 * (y - z)]


def luminance(colour: str) -> float:
    r, g, b = linear(colour)
    return 0.2126 * r + 0.7152 * g + 0.0722 * b


def test_nine_colours_are_distinct_in_light_and_dark() -> None:
    light, dark, *_ = re.findall(r":root \{(.*?)\}", CSS.read_text(), re.S)
    for scheme in (light, dark):
        colours = [re.search(rf"--axis-{i}: (#\w{{6}})", scheme) for i in range(9)]
        found = [each[1] for each in colours if each is not None]
        assert len(found) == 9
        for a, b in itertools.combinations(found, 2):
            apart = sum((x - y) ** 2 for x, y in zip(lab(a), lab(b), strict=True)) ** 0.5
            assert apart > DISTANCE, (a, b)
        card = re.search(r"--card: (#\w{6})", scheme)
        assert card is not None
        for each in found:
            bright, dim = sorted((luminance(each), luminance(card[1])), reverse=True)
            assert (bright + 0.05) / (dim + 0.05) >= CONTRAST, each


def readout(it: OpenPage, title: str) -> str:
    return it.page.locator("figure", has_text=title).locator(".readout").inner_text()


def test_the_newest_values_stand_beside_the_plot(it: OpenPage, running: Running) -> None:
    with running.client() as client:
        measured = client.status()["robots"]["f0"]["axes"]["left"]["measured_mm"]
    until(lambda: f"left {measured:.0f}" in re.sub(r"\.\d+", "", readout(it, "Axes")), "axes are read")
    assert re.search(r"x −?\d+\.\d\d", readout(it, "Tip"))


def test_plots_are_chosen_and_moved_by_buttons(it: OpenPage) -> None:
    figures = it.page.locator("#plots figure")
    assert figures.count() == 2
    it.page.locator("#plots").get_by_role("button", name="Voltage").click()
    it.page.locator("figure", has_text="Voltage [V]").wait_for()
    it.page.locator("#plots").get_by_role("button", name="Tip", exact=True).click()
    assert figures.count() == 2
    live = it.page.get_by_role("button", name="Show the newest seconds")
    assert live.get_attribute("aria-pressed") == "true"
    it.page.wait_for_timeout(1500)
    it.page.get_by_role("button", name="Earlier").click()
    assert live.get_attribute("aria-pressed") == "false"
    still = readout(it, "Axes")
    it.page.wait_for_timeout(700)
    assert readout(it, "Axes") == still  # what is looked at does not run away
    live.click()
    assert live.get_attribute("aria-pressed") == "true"


def test_plots_are_moved_by_hand(it: OpenPage) -> None:
    it.page.wait_for_timeout(1500)
    over = it.page.locator("#plots .u-over").first
    box = over.bounding_box()
    assert box is not None
    live = it.page.get_by_role("button", name="Show the newest seconds")
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    it.page.mouse.move(x, y)
    it.page.mouse.down()
    it.page.mouse.move(x + 60, y, steps=4)
    it.page.mouse.up()
    assert live.get_attribute("aria-pressed") == "false"
    over.dblclick()
    assert live.get_attribute("aria-pressed") == "true"
    it.page.keyboard.down("Control")
    it.page.mouse.wheel(0, -400)
    it.page.keyboard.up("Control")
    it.page.wait_for_function(
        "document.querySelector('.timespan [aria-pressed]').getAttribute('aria-pressed') === 'false'"
    )
