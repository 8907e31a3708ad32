"""The page in a real browser against axe-core: WCAG 2.2 AA, light and dark, on phones and large screens."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib.resources import files
from typing import Any, Final, Literal

import pytest

pytest.importorskip("playwright.sync_api", reason="pip install 'contid[test]'")
pytest.importorskip("axe_playwright_python", reason="pip install 'contid[test]'")

from playwright.sync_api import Browser

from tests.support.browser import OpenPage, opened
from tests.support.daemons import daemon
from tests.support.panels import PanelProcess, panel

#: Leases lapse in real time, and the browser shares the cores.
pytestmark = [pytest.mark.process, pytest.mark.realtime]

AXE: Final = files("axe_playwright_python").joinpath("axe.min.js").read_text(encoding="utf-8")
RULES: Final = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]
SILENT: Final = "faults:\n  - {at_s: 2.0, for_s: 600.0, kind: silent, axis: f0.left}\n"
#: Schemes and widths [px].
LOOKS: Final[list[tuple[Literal["light", "dark"], int]]] = [
    ("light", 390), ("dark", 1280), ("light", 1280), ("dark", 390),
]  # fmt: skip
#: With them every scheme and every width is seen; rules of one scheme at one width only are at rest too.
BOTH: Final = LOOKS[:2]
#: Text that a rule of axe leaves out, as it is of a control that is disabled.
DIM_TEXT: Final = """() => {
    const channel = (v) => (v / 255 <= 0.03928 ? v / 255 / 12.92 : ((v / 255 + 0.055) / 1.055) ** 2.4);
    const rgba = (text) => text.match(/[\\d.]+/g).map(Number);
    const light = ([r, g, b]) => 0.2126 * channel(r) + 0.7152 * channel(g) + 0.0722 * channel(b);
    const behind = (element) => {
        for (let each = element; each; each = each.parentElement) {
            const found = rgba(getComputedStyle(each).backgroundColor);
            if (found[3] === undefined || found[3] === 1) return found;
        }
        return [255, 255, 255];
    };
    const found = [];
    for (const element of document.querySelectorAll(
        'button, select, input:not([type=range]):not([type=file]), span, p, td, th, legend, b, h2')) {
        if (!element.checkVisibility() || !element.innerText && !element.value) continue;
        const style = getComputedStyle(element);
        const [a, b] = [light(rgba(style.color)), light(behind(element))].sort((x, y) => y - x);
        const ratio = (a + 0.05) / (b + 0.05) * (style.opacity === '1' ? 1 : 0);
        const text = element.innerText || element.value;
        if (ratio < 4.5) found.push(`${element.tagName} ${text}: ${ratio.toFixed(2)}`);
    }
    return found;
}"""


def violations(it: OpenPage) -> list[str]:
    """What axe-core finds, one line for each element."""
    it.page.evaluate(AXE)
    found: dict[str, Any] = it.page.evaluate(
        "(values) => axe.run(document, { runOnly: { type: 'tag', values }, resultTypes: ['violations'] })",
        RULES,
    )
    return [
        f"{rule['id']}: {node['html'][:120]} {node.get('failureSummary', '')}"
        for rule in found["violations"]
        for node in rule["nodes"]
    ]


def dim(it: OpenPage) -> list[str]:
    """Visible text with less contrast than 4.5 to 1, that of disabled controls too."""
    found: list[str] = it.page.evaluate(DIM_TEXT)
    return found


def problems(it: OpenPage, looks: Sequence[tuple[Literal["light", "dark"], int]] = BOTH) -> list[str]:
    """What is found in light and dark, on a phone and on a large screen."""
    found = []
    for scheme, width in looks:
        it.page.emulate_media(color_scheme=scheme)
        it.page.set_viewport_size({"width": width, "height": 844})
        it.page.wait_for_timeout(300)
        found += [f"{scheme} {width}: {text}" for text in (*violations(it), *dim(it))]
    return found


@pytest.fixture(scope="module")
def faulty() -> Iterator[PanelProcess]:
    with daemon(2, options=SILENT) as running, panel(running) as served:
        yield served


def test_a_page_at_rest(drawn: OpenPage) -> None:
    assert problems(drawn, LOOKS) == []


def test_a_page_in_control(it: OpenPage) -> None:
    it.take_control()
    it.page.get_by_role("button", name="Record").click()
    it.page.wait_for_selector(".toast")
    it.page.get_by_role("textbox", name="Name of the pose").fill("here")
    assert problems(it) == []


def test_a_page_with_a_fault(browser: Browser, faulty: PanelProcess) -> None:
    with opened(browser, faulty) as it:
        it.page.wait_for_selector("#faults:not([hidden])")
        assert problems(it) == []


def test_the_contrast_is_measured(it: OpenPage) -> None:
    """Grey on white is found by both, so that nothing found means something."""
    pale = "(all) => all.forEach((each) => { each.style.color = '#aaa'; })"
    it.page.locator(".meaning").evaluate_all(pale)
    assert any("color-contrast" in text for text in violations(it))
    assert any("holds its position" in text for text in dim(it))


def test_a_fault_is_announced_and_leads_to_its_remedy(browser: Browser, faulty: PanelProcess) -> None:
    with opened(browser, faulty, viewport={"width": 390, "height": 600}) as it:
        it.page.wait_for_selector("#faults:not([hidden])")
        banner = it.page.get_by_role("alert").filter(has_text="f0: fault 102")
        assert banner.is_visible()
        it.page.mouse.wheel(0, 5000)
        banner.get_by_role("link").click()
        assert it.page.evaluate("document.activeElement.id") == "robot-f0"
        assert it.page.locator(".fault:not([hidden])").is_visible()
        assert faulty.token in it.page.evaluate("location.hash")  # a reload needs it
