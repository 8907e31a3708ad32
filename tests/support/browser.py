"""A real browser for tests of pages: an installed Chromium, or the one that playwright installed."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import pytest
from playwright.sync_api import Browser, BrowserContext, Error, Page, Playwright

from tests.support.daemons import Running
from tests.support.panels import PanelProcess

NAMES: Final = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
#: Tests may run as root in a container, where there is no sandbox.
ARGUMENTS: Final = ("--no-sandbox",)
#: WebGL without a graphics card: a page that draws takes 1.3 to 2 s of processor time more.
DRAWING: Final = (
    "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist",
)  # fmt: skip
NOT_DRAWING: Final = ("--disable-gpu", "--disable-3d-apis")
#: A loaded machine draws slowly; only a hang fails.
TIMEOUT_MS: Final = 60_000


@contextmanager
def chromium(playwright: Playwright, *, draws: bool) -> Iterator[Browser]:
    """A headless Chromium, with or without WebGL; the test is skipped where there is none."""
    browser = _launched(playwright, (*ARGUMENTS, *(DRAWING if draws else NOT_DRAWING)))
    try:
        yield browser
    finally:
        browser.close()


def _launched(playwright: Playwright, arguments: tuple[str, ...]) -> Browser:
    path = next(
        filter(None, map(shutil.which, (os.environ.get("CONTID_CHROMIUM", "chromium"), *NAMES))), None
    )
    if path is None and not Path(playwright.chromium.executable_path).exists():
        pytest.skip("no Chromium: apt install chromium, or playwright install chromium")
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

    def __init__(self, context: BrowserContext, served: PanelProcess) -> None:
        self.page: Page = context.new_page()
        self.page.set_default_timeout(TIMEOUT_MS)
        self.problems: list[str] = []
        self.page.on("pageerror", lambda error: self.problems.append(str(error)))
        self.page.on("console", lambda it: self.problems.append(it.text) if it.type == "error" else None)
        self.page.goto(served.url)

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
    """A page of a panel in a context of its own; its console must stay free of errors."""
    context = browser.new_context(**({"viewport": {"width": 1280, "height": 860}} | keys))  # type: ignore[arg-type]
    try:
        found = OpenPage(context, served)
        yield found
        unexpected = [text for text in found.problems if "WebSocket connection" not in text]
        assert not unexpected
    finally:
        context.close()


def tip_mm(running: Running, robot: str = "f0") -> list[float]:
    """The tip of a robot, as its daemon reports it."""
    with running.client() as client:
        found: list[float] = client.status()["robots"][robot]["tip_mm"]
    return found
