"""The page in a real browser against axe-core: WCAG 2.2 AA, light and dark, on phones and large screens."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, Literal

import pytest

pytest.importorskip("playwright.sync_api", reason="pip install 'contid[test]'")
pytest.importorskip("axe_playwright_python", reason="pip install 'contid[test]'")

from tests.support.browser import OpenPage, dim, violations

#: Leases lapse in real time, and the browser shares the cores.
pytestmark = [pytest.mark.process, pytest.mark.realtime]

#: Schemes and widths [px].
LOOKS: Final[list[tuple[Literal["light", "dark"], int]]] = [
    ("light", 390), ("dark", 1280), ("light", 1280), ("dark", 390),
]  # fmt: skip
#: With them every scheme and every width is seen; rules of one scheme at one width only are a campaign.
BOTH: Final = LOOKS[:2]


def problems(it: OpenPage, looks: Sequence[tuple[Literal["light", "dark"], int]] = BOTH) -> list[str]:
    """What is found in light and dark, on a phone and on a large screen."""
    found = []
    for scheme, width in looks:
        it.page.emulate_media(color_scheme=scheme)
        it.page.set_viewport_size({"width": width, "height": 844})
        it.page.wait_for_timeout(300)
        found += [f"{scheme} {width}: {text}" for text in (*violations(it), *dim(it))]
    return found


@pytest.mark.parametrize(
    "looks", [BOTH, pytest.param(LOOKS[2:], marks=pytest.mark.campaign)], ids=["both", "others"]
)
def test_a_page_at_rest(drawn: OpenPage, looks: Sequence[tuple[Literal["light", "dark"], int]]) -> None:
    assert problems(drawn, looks) == []


def test_a_page_in_control(it: OpenPage) -> None:
    it.take_control()
    it.page.get_by_role("button", name="Record").click()
    it.page.wait_for_selector(".toast")
    it.page.get_by_role("textbox", name="Name of the pose").fill("here")
    assert problems(it) == []


def test_the_contrast_is_measured(it: OpenPage) -> None:
    """Grey on white is found by both, so that nothing found means something."""
    pale = "(all) => all.forEach((each) => { each.style.color = '#aaa'; })"
    it.page.locator(".meaning").evaluate_all(pale)
    assert any("color-contrast" in text for text in violations(it))
    assert any("holds its position" in text for text in dim(it))


def test_a_message_takes_no_press_of_what_it_lies_over(it: OpenPage) -> None:
    it.page.set_viewport_size({"width": 390, "height": 844})
    it.take_control()
    it.page.get_by_role("button", name="Record").click()
    it.page.wait_for_selector(".toast")
    over = """() => {
        const { left, top, width, height } = document.querySelector('.toast').getBoundingClientRect();
        const hold = document.querySelector('.robot[data-robot=f1] .orders button');
        const box = hold.getBoundingClientRect();
        window.scrollBy(0, box.top + box.height / 2 - top - height / 2);
        const at = hold.getBoundingClientRect();
        const x = at.left + at.width / 2, y = at.top + at.height / 2;
        const covered = left < x && x < left + width && top < y && y < top + height;
        return [x, y, hold.textContent, covered];
    }"""
    x, y, name, covered = it.page.evaluate(over)
    assert covered
    it.page.evaluate(
        "() => addEventListener('pointerdown', (event) => { window.pressed = event.target.textContent; })"
    )
    it.page.mouse.click(x, y)
    assert it.page.evaluate("() => window.pressed") == name
