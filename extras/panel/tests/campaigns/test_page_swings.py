"""A body that swings, as the page draws it in a real browser."""

from __future__ import annotations

import io
import os

import numpy as np
import pytest

from contid_panel.geometry import MODES

pytestmark = pytest.mark.campaign


def seen_pixels(image: bytes) -> int:
    """Pixels in the colour of swings, bright or through which one sees."""
    from PIL import Image

    red, green, blue = np.moveaxis(np.asarray(Image.open(io.BytesIO(image)).convert("RGB"), dtype=int), 2, 0)
    return int(((red > green + 20) & (green > blue + 25) & (red > 120)).sum())


@pytest.mark.process
@pytest.mark.realtime
def test_a_press_draws_the_slowest_mode_and_the_last_press_ends_it() -> None:
    """With ``CONTID_SWING_IMAGE`` the view is kept there as an image."""
    sync = pytest.importorskip("playwright.sync_api", reason="pip install 'contid[test]'")
    from tests.support.browser import chromium, opened
    from tests.support.daemons import shipped
    from tests.support.panels import panel

    with (
        shipped("stiffflop2") as started,
        panel(started) as served,
        sync.sync_playwright() as playwright,
        chromium(playwright, draws=True) as browser,
        opened(browser, served) as it,
    ):
        button = it.page.get_by_role("button", name="Swing", exact=True)
        button.click()
        it.page.wait_for_selector("#view[data-swings='1']")
        assert "mode 1 of 3" in it.text(".swing .meaning")
        right = "document.querySelector('.robot').getBoundingClientRect().right"
        assert it.page.evaluate(f"{right} <= document.documentElement.clientWidth")
        it.page.wait_for_timeout(500)
        image = it.page.locator("#view").screenshot(path=os.environ.get("CONTID_SWING_IMAGE"))
        assert seen_pixels(image) > 1000
        for _ in range(MODES):
            button.click()
        it.page.wait_for_selector("#view[data-swings='0']")
        assert it.text(".swing .meaning") == ""
