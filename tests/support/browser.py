"""A real browser for tests of pages: an installed Chromium, or the one that playwright installed."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

import pytest
from playwright.sync_api import Browser, ConsoleMessage, Error, Page, Playwright, ViewportSize, WebSocket

from tests.support.daemons import Running
from tests.support.panels import PanelProcess

#: The first one has no windows of its own: to open a page takes it half the processor time of the second.
NAMES: Final = (
    "chromium-headless-shell", "chromium", "chromium-browser", "google-chrome", "google-chrome-stable",
)  # fmt: skip
#: Tests may run as root in a container, where there is no sandbox.
ARGUMENTS: Final = ("--no-sandbox",)
#: WebGL without a graphics card: a page that draws takes 1.3 to 2 s of processor time more.
DRAWING: Final = (
    "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist",
)  # fmt: skip
NOT_DRAWING: Final = ("--disable-gpu", "--disable-3d-apis")
#: A loaded machine draws slowly; only a hang fails.
TIMEOUT_MS: Final = 60_000
VIEWPORT: Final[ViewportSize] = {"width": 1280, "height": 860}


@contextmanager
def chromium(playwright: Playwright, *, draws: bool) -> Iterator[Browser]:
    """A headless Chromium, with or without WebGL; the test is skipped where there is none."""
    browser = _launched(playwright, (*ARGUMENTS, *(DRAWING if draws else NOT_DRAWING)))
    try:
        yield browser
    finally:
        browser.close()


def _launched(playwright: Playwright, arguments: tuple[str, ...]) -> Browser:
    names = (os.environ.get("CONTID_CHROMIUM", NAMES[0]), *NAMES)
    path = next(filter(None, map(shutil.which, names)), None)
    if path is None and not Path(playwright.chromium.executable_path).exists():
        pytest.skip("no Chromium: apt install chromium-headless-shell, or playwright install chromium")
    try:
        return playwright.chromium.launch(executable_path=path, args=list(arguments), timeout=TIMEOUT_MS)
    except Error as error:
        pytest.skip(f"Chromium does not start here: {str(error).splitlines()[0]}")


class OpenPage:
    """A page of a panel, and what its console reported.

    Attributes:
        page: of playwright.
        problems: errors of scripts and violations of the policy.
    """

    def __init__(self, page: Page) -> None:
        self.page = page
        self.problems: list[str] = []
        page.set_default_timeout(TIMEOUT_MS)
        page.on("pageerror", self._take_error)
        page.on("console", self._take_message)

    def check(self) -> None:
        """Fail for errors of its scripts; a panel that ends breaks its WebSocket."""
        unexpected = [text for text in self.problems if "WebSocket connection" not in text]
        assert not unexpected

    def forget(self) -> None:
        """Listen no more."""
        self.page.remove_listener("pageerror", self._take_error)
        self.page.remove_listener("console", self._take_message)

    def _take_error(self, error: Error) -> None:
        self.problems.append(str(error))

    def _take_message(self, message: ConsoleMessage) -> None:
        if message.type == "error":
            self.problems.append(message.text)

    def state(self, robot: str, state: str) -> None:
        """Wait for the state of a robot."""
        self.page.wait_for_selector(f".robot[data-robot={robot}][data-state={state}]")

    def take_control(self) -> None:
        """Acquire the lease."""
        self.page.get_by_role("button", name="Take control").click()
        self.page.wait_for_selector("#lease[data-mine=true]")

    def slider(self, robot: str, name: str) -> str:
        """Selector of a slider."""
        return f".robot[data-robot={robot}] input[aria-label={name}]"

    def value(self, robot: str, name: str) -> float:
        """The measured number beside a slider."""
        output = "(input) => input.closest('.slider').querySelector('output').textContent"
        text: str = self.page.locator(self.slider(robot, name)).evaluate(output)
        return float(text.replace("−", "-").replace("–", "nan"))

    def text(self, selector: str) -> str:
        """The text of an element."""
        return self.page.locator(selector).inner_text()


@contextmanager
def opened(browser: Browser, served: PanelProcess, **keys: object) -> Iterator[OpenPage]:
    """A page of a panel in a context of its own, as of another device."""
    context = browser.new_context(**({"viewport": VIEWPORT} | keys))  # type: ignore[arg-type]
    try:
        found = OpenPage(context.new_page())
        found.page.goto(served.url)
        yield found
        found.check()
    finally:
        context.close()


class Tab:
    """One page of a browser that tests visit one after another, each as the first one.

    A page in a context of its own takes 2.5 s of a processor, mostly to start a renderer.

    Args:
        browser: where it is.
        keys: of `Browser.new_context`.
    """

    def __init__(self, browser: Browser, **keys: object) -> None:
        self._browser = browser
        self._keys = {"viewport": VIEWPORT, "color_scheme": "light"} | keys
        self._page: Page | None = None

    @contextmanager
    def opened(
        self, served: PanelProcess, on_websocket: Callable[[WebSocket], None] | None = None
    ) -> Iterator[OpenPage]:
        """Visit a panel; ``on_websocket`` gets each connection that the page makes."""
        found = OpenPage(self._blank())
        if on_websocket is not None:
            found.page.on("websocket", on_websocket)
        try:
            found.page.goto(served.url)
            yield found
            found.check()
        except BaseException:
            self.close()
            raise
        found.forget()
        if on_websocket is not None:
            found.page.remove_listener("websocket", on_websocket)
        self._leave(served)

    def close(self) -> None:
        """End the page; the next visit has a new one."""
        if self._page is not None:
            page, self._page = self._page, None
            page.context.close()

    def _blank(self) -> Page:
        if self._page is None:
            self._page = self._browser.new_context(**self._keys).new_page()  # type: ignore[arg-type]
        return self._page

    def _leave(self, served: PanelProcess) -> None:
        """End the document with what it stored, and put back what tests set at the page.

        Its place takes a document of the same site, which needs no other renderer as an empty page does.
        """
        assert self._page is not None
        if self._page.is_closed():
            self.close()
            return
        page = self._page
        try:
            page.evaluate("() => { sessionStorage.clear(); localStorage.clear(); }")
            page.goto(f"{served.origin}/static/icon.svg" if served.process.poll() is None else "about:blank")
            page.unroute_all()
            page.context.clear_cookies()
            page.mouse.up()
            page.mouse.move(-1.0, -1.0)
            page.keyboard.up("Control")
            page.set_viewport_size(self._keys["viewport"])  # type: ignore[arg-type]
            page.emulate_media(color_scheme=self._keys["color_scheme"])  # type: ignore[arg-type]
        except Error:
            self.close()
            raise


def tip_mm(running: Running, robot: str = "f0") -> list[float]:
    """The tip of a robot, as its daemon reports it."""
    with running.client() as client:
        found: list[float] = client.status()["robots"][robot]["tip_mm"]
    return found


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
    it.page.evaluate(files("axe_playwright_python").joinpath("axe.min.js").read_text(encoding="utf-8"))
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
