"""The page in a real browser: the first key on every slider of every shipped robot moves it from rest."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final

import pytest

pytest.importorskip("playwright.sync_api", reason="pip install 'contid[test]'")

from playwright.sync_api import Browser, Locator

from contid.client import Client
from tests.support.browser import OpenPage, opened
from tests.support.daemons import BLOCKED, SHIPPED, shipped
from tests.support.panels import panel
from tests.support.waiting import until

#: Leases lapse in real time, and the browser shares the cores.
pytestmark = [pytest.mark.process, pytest.mark.realtime]

#: What a key changes of the commands at the least, in the units of the axes.
FLOOR: Final = 1e-6


@dataclass
class Seen:
    """Where the robots of a page are commanded to, from the daemon and not from the page."""

    client: Client

    def robot(self, name: str) -> dict[str, Any]:
        for frame in self.client.telemetry(50.0, fields=("state", "command", "command_tip_mm", "bends")):
            return dict(frame["robots"][name])
        raise AssertionError("no telemetry")

    def at(self, name: str) -> list[float]:
        """The commands of the axes of a robot that stands."""
        found: list[list[float]] = [[], []]

        def stands() -> bool:
            newest = self.robot(name)
            found.append(list(newest["command"]))
            return newest["state"] == "HOLD" and found[-1] == found[-2] == found[-3]

        until(stands, f"{name} stands", seconds=20.0)
        return found[-1]


@contextmanager
def under_hands(browser: Browser, name: str) -> Iterator[tuple[OpenPage, Seen]]:
    """A shipped robot, armed and at rest, before a page that has the lease."""
    with shipped(name) as running, panel(running) as served, opened(browser, served) as it:
        it.page.wait_for_selector(".robot[data-state=HOLD]")
        it.take_control()
        it.page.wait_for_selector(".robot input:enabled")
        with running.client() as client:
            yield it, Seen(client)


def goes_home(it: OpenPage, seen: Seen, robot: str) -> None:
    """Press *Rest pose* and wait until the robot has gone there, or was there."""
    it.page.locator(f".robot[data-robot={robot}]").get_by_role("button", name="Rest pose").click()
    it.page.wait_for_timeout(200)
    seen.at(robot)


def first_key(it: OpenPage, seen: Seen, robot: str, slider: Locator, key: str) -> tuple[bool, str]:
    """Press one key from rest: whether the robot moves, and the reason on the page if it does not."""
    before = seen.at(robot)
    slider.focus()
    it.page.keyboard.press(key)
    note = it.page.locator(f".robot[data-robot={robot}] .refused")
    refused = ""

    def ends() -> bool:
        nonlocal refused
        refused = note.inner_text()
        return bool(refused) or math.dist(seen.robot(robot)["command"], before) > FLOOR

    try:
        until(ends, "it moves or is refused", seconds=20.0)
    except AssertionError:
        return False, ""
    return not refused, refused


@pytest.mark.campaign
@pytest.mark.parametrize("name", SHIPPED)
@pytest.mark.timeout(900)
def test_the_first_key_moves_in_every_free_direction(browser: Browser, name: str) -> None:
    """One way or the other; what no robot of this kind can move alone is refused with its reason."""
    dead: list[str] = []
    straight: list[str] = []
    silent: list[str] = []
    with under_hands(browser, name) as (it, seen):
        cards = it.page.locator(".robot")
        for robot in [str(cards.nth(k).get_attribute("data-robot")) for k in range(cards.count())]:
            goes_home(it, seen, robot)  # simulated devices may begin elsewhere
            sliders = it.page.locator(f".robot[data-robot={robot}] input[type=range]")
            for number in range(sliders.count()):
                slider, what = sliders.nth(number), ""
                for key in ("ArrowRight", "ArrowLeft"):
                    moved, why = first_key(it, seen, robot, slider, key)
                    goes_home(it, seen, robot)
                    if moved:
                        break
                    what = f"{robot} {slider.get_attribute('aria-label')}"
                    if len(why) < 20:
                        silent.append(f"{what} {key}: {why!r}")
                else:
                    (straight if "straight" in why else dead).append(what)
    print(f"{name}: {straight} turn nothing where it is straight")
    assert (silent, dead) == ([], [column.rpartition("_")[0] for column in BLOCKED.get(name, [])])
    assert all(what.endswith("azimuth") for what in straight)
