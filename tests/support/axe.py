"""Barriers in a page: what axe-core finds, and text without contrast."""

from __future__ import annotations

from importlib.resources import files
from typing import Any, Final

from tests.support.browser import OpenPage

AXE: Final = files("axe_playwright_python").joinpath("axe.min.js").read_text(encoding="utf-8")
RULES: Final = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]
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
