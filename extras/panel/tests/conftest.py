"""A browser, two fingers, their panel and its open page, for the tests of the page."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

from tests.support.daemons import Running, armed_daemon, as_started
from tests.support.panels import PanelProcess, panel

if TYPE_CHECKING:  # the other tests of the panel need no playwright
    from playwright.sync_api import Browser, Page, Playwright

    from tests.support.browser import OpenPage


#: Of the daemons: twice what the page sends and shows in a second.
RATE_HZ = 50


@pytest.fixture(scope="module")
def playwright() -> Iterator[Playwright]:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as started:
        yield started


@pytest.fixture(scope="module")
def browser(playwright: Playwright) -> Iterator[Browser]:
    """Without WebGL: everything of the page but its view of the robots."""
    from tests.support.browser import chromium

    with chromium(playwright, draws=False) as started:
        yield started


@pytest.fixture(scope="module")
def drawing(playwright: Playwright) -> Iterator[Browser]:
    """With WebGL."""
    from tests.support.browser import chromium

    with chromium(playwright, draws=True) as started:
        yield started


@pytest.fixture(scope="module")
def shared() -> Iterator[tuple[Running, PanelProcess]]:
    """Two fingers and their panel, of all tests of a module but those that end one of them."""
    with armed_daemon(2, rate_hz=RATE_HZ) as started, panel(started) as served:
        yield started, served


@pytest.fixture
def alone() -> Iterator[tuple[Running, PanelProcess]]:
    """Two fingers and their panel, of a test that ends one of them."""
    with armed_daemon(2, rate_hz=RATE_HZ) as started, panel(started) as served:
        yield started, served


@pytest.fixture
def both(
    request: pytest.FixtureRequest, shared: tuple[Running, PanelProcess]
) -> tuple[Running, PanelProcess]:
    """What this test has: its own with `usefixtures("alone")`, else the module's, as after their start."""
    if "alone" in request.fixturenames:
        return request.getfixturevalue("alone")
    as_started(shared[0])
    return shared


@pytest.fixture
def running(both: tuple[Running, PanelProcess]) -> Running:
    return both[0]


@pytest.fixture
def served(both: tuple[Running, PanelProcess]) -> PanelProcess:
    return both[1]


@pytest.fixture(scope="module")
def idle(browser: Browser) -> Iterator[Page]:
    """A page that only lends its modules; it has no policy against `Function`."""
    with armed_daemon(1, rate_hz=RATE_HZ) as started, panel(started) as served:
        context = browser.new_context(bypass_csp=True)
        page = context.new_page()
        page.goto(served.url)
        yield page
        context.close()


@pytest.fixture
def it(browser: Browser, served: PanelProcess) -> Iterator[OpenPage]:
    from tests.support.browser import opened

    with opened(browser, served) as page:
        page.state("f0", "HOLD")
        yield page


@pytest.fixture
def drawn(drawing: Browser, served: PanelProcess) -> Iterator[OpenPage]:
    """A page that draws the robots."""
    from tests.support.browser import opened

    with opened(drawing, served) as page:
        page.state("f0", "HOLD")
        yield page
