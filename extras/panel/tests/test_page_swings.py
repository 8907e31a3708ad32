"""How a robot swings, in the panel: lines of its modes, and the page that draws them in a real browser."""

from __future__ import annotations

import os

import numpy as np
import pytest

from contid.errors import ContidError
from contid.robot_file.load import load_named
from contid_dynamics.report import pose_modes
from contid_panel.geometry import PanelGeometry
from contid_panel.swings import MODES, modes


def test_lines_are_of_the_modes_and_keep_their_length() -> None:
    loaded = load_named("stiffflop2")
    geometry, actuation = PanelGeometry(loaded, 100.0), (3e4, 0.0, 0.0, 2e4, 0.0, 0.0)
    (name, robot), *_ = loaded.driven.items()
    found = modes(geometry, name, actuation)["modes"]
    expected = pose_modes(robot, actuation, MODES).modes
    assert [each["frequency_hz"] for each in found] == [each.frequency_hz for each in expected]
    for mode in found:
        low, rest, high = np.array(mode["lines"])
        lengths = [np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in (low, rest, high)]
        assert max(lengths) < 1.02 * min(lengths)
        moved = np.linalg.norm(high - rest, axis=1)
        assert moved[0] == 0.0
        assert 0.05 * lengths[1] < moved.max() < 0.2 * lengths[1]


def test_a_robot_without_dynamics_has_a_reason() -> None:
    loaded = load_named("finger")
    (name,) = loaded.driven
    with pytest.raises(ContidError, match="no dynamics in its robot file"):
        modes(PanelGeometry(loaded, 100.0), name, (0.05, 0.05))


@pytest.mark.process
@pytest.mark.realtime
def test_a_press_draws_the_slowest_mode_and_the_last_press_ends_it() -> None:
    """With ``CONTID_SWING_IMAGE`` the page is kept there as an image."""
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
        if image := os.environ.get("CONTID_SWING_IMAGE"):
            it.page.wait_for_timeout(700)
            it.page.screenshot(path=image)
        for _ in range(MODES):
            button.click()
        it.page.wait_for_selector("#view[data-swings='0']")
        assert it.text(".swing .meaning") == ""
