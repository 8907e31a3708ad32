"""A browser, two fingers, their panel and its open page, for the tests of the page."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar

import pytest

from tests.support.daemons import Running, armed_daemon, as_started
from tests.support.panels import PanelProcess, panel

if TYPE_CHECKING:  # the other tests of the panel need no playwright
    from playwright.sync_api import Browser, Page, Playwright

    from tests.support.browser import OpenPage, Tab


#: Of the daemons: twice what the page sends and shows in a second.
RATE_HZ = 50


#: Of a page that draws: it takes a program half as long as a page of the usual size.
DRAWN: Final = {"width": 940, "height": 640}

#: Its tests share one browser, one panel and one page that lends its modules: to start them takes 6 to 10 s
#: of a processor.
PAGES: Final = Path(__file__).parent / "page"
_Made = TypeVar("_Made")


class Kept:
    """What tests share; it ends before a test of another file, that of `PAGES` before one of another folder.

    Playwright keeps an event loop running in the thread of the tests: no test with a coroutine may follow.
    """

    def __init__(self) -> None:
        self._stack = ExitStack()
        self._made: dict[str, Any] = {}

    def get(self, name: str, make: Callable[[], AbstractContextManager[_Made]]) -> _Made:
        """What was made under this name, or make it."""
        if name not in self._made:
            self._made[name] = self._stack.enter_context(make())
        made: _Made = self._made[name]
        return made

    def close(self) -> None:
        """End everything, the newest first."""
        self._made.clear()
        self._stack.close()


KEPT: Final = Kept()


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_teardown(
    item: pytest.Item, nextitem: pytest.Item | None
) -> Generator[None, object, object]:
    """End what tests share once the next one does not share it."""
    try:
        return (yield)
    finally:
        if nextitem is None or _sharers(nextitem) != _sharers(item):
            KEPT.close()


def _sharers(item: pytest.Item) -> Path:
    return PAGES if item.path.parent == PAGES else item.path


@pytest.fixture(scope="module")
def playwright() -> Playwright:
    from playwright.sync_api import sync_playwright

    return KEPT.get("playwright", sync_playwright)


@pytest.fixture(scope="module")
def browser(playwright: Playwright) -> Browser:
    """Without WebGL: everything of the page but its view of the robots."""
    from tests.support.browser import chromium

    return KEPT.get("browser", lambda: chromium(playwright, draws=False))


@pytest.fixture(scope="module")
def drawing(playwright: Playwright) -> Browser:
    """With WebGL."""
    from tests.support.browser import chromium

    return KEPT.get("drawing", lambda: chromium(playwright, draws=True))


@contextmanager
def _two_fingers() -> Iterator[tuple[Running, PanelProcess]]:
    with armed_daemon(2, rate_hz=RATE_HZ) as started, panel(started) as served:
        yield started, served


@pytest.fixture(scope="module")
def shared() -> tuple[Running, PanelProcess]:
    """Two fingers and their panel, of all tests but those that end one of them."""
    return KEPT.get("two fingers", _two_fingers)


@pytest.fixture
def alone() -> Iterator[tuple[Running, PanelProcess]]:
    """Two fingers and their panel, of a test that ends one of them."""
    with _two_fingers() as made:
        yield made


@pytest.fixture
def other_panel(shared: tuple[Running, PanelProcess]) -> Iterator[tuple[Running, PanelProcess]]:
    """The shared fingers, and a panel of a test that ends it."""
    as_started(shared[0])
    with panel(shared[0]) as served:
        yield shared[0], served


@pytest.fixture
def both(
    request: pytest.FixtureRequest, shared: tuple[Running, PanelProcess]
) -> tuple[Running, PanelProcess]:
    """By `usefixtures` ``alone`` or ``other_panel``, else the shared fingers, as after their start."""
    for name in ("alone", "other_panel"):
        if name in request.fixturenames:
            made: tuple[Running, PanelProcess] = request.getfixturevalue(name)
            return made
    as_started(shared[0])
    return shared


@pytest.fixture
def running(both: tuple[Running, PanelProcess]) -> Running:
    return both[0]


@pytest.fixture
def served(both: tuple[Running, PanelProcess]) -> PanelProcess:
    return both[1]


@pytest.fixture(scope="module")
def idle(browser: Browser, shared: tuple[Running, PanelProcess]) -> Page:
    """A page that only lends its modules: it does not connect, and has no policy against `Function`."""

    @contextmanager
    def made() -> Iterator[Page]:
        context = browser.new_context(bypass_csp=True)
        page = context.new_page()
        page.route("**/files/*/main.js", lambda asked: asked.fulfill(content_type="text/javascript", body=""))
        page.goto(shared[1].url)
        yield page
        context.close()

    return KEPT.get("idle", made)


@contextmanager
def _tab(browser: Browser, **keys: object) -> Iterator[Tab]:
    from tests.support.browser import Tab

    made = Tab(browser, **keys)
    try:
        yield made
    finally:
        made.close()


@pytest.fixture(scope="module")
def tab(browser: Browser) -> Tab:
    """A page that tests visit one after another."""
    return KEPT.get("tab", lambda: _tab(browser))


@pytest.fixture(scope="module")
def drawing_tab(drawing: Browser) -> Tab:
    """A page that draws the robots, which tests visit one after another."""
    return KEPT.get("drawing tab", lambda: _tab(drawing, viewport=DRAWN))


@pytest.fixture
def it(tab: Tab, served: PanelProcess) -> Iterator[OpenPage]:
    with tab.opened(served) as page:
        page.state("f0", "HOLD")
        yield page


@pytest.fixture
def drawn(drawing_tab: Tab, served: PanelProcess) -> Iterator[OpenPage]:
    """A page that draws the robots."""
    with drawing_tab.opened(served) as page:
        page.state("f0", "HOLD")
        yield page
