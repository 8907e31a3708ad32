"""A first visit in a real browser: `contid demo`, and everything that a new user touches until STOP.

The whole, four robots at two widths in light and dark, is a campaign; `CONTID_VISIT_PICTURES=FOLDER` keeps an
image of every step.
"""

from __future__ import annotations

import io
import os
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import numpy as np
import psutil
import pytest
from matplotlib.image import imread

pytest.importorskip("playwright.sync_api", reason="pip install 'contid[test]'")
pytest.importorskip("axe_playwright_python", reason="pip install 'contid[test]'")

from playwright.sync_api import Browser, Locator

from contid.client import Client
from contid.remote.client.described_robot import columns_of
from tests.support.browser import OpenPage, dim, opened, violations
from tests.support.daemons import command
from tests.support.panels import PanelProcess
from tests.support.waiting import until

#: Leases lapse in real time, and the browser shares the cores.
pytestmark = [pytest.mark.process, pytest.mark.realtime]

ROBOTS = ("hand", "stiffflop2", "tendon3", "catheter")
MOVES_ITSELF, ARMED, FAULT, OFF = "RUN", "HOLD", "FAULT", "OFF"


@contextmanager
def demo(robot: str, folder: Path) -> Iterator[tuple[PanelProcess, subprocess.Popen[str]]]:
    """`contid demo ROBOT` of a user who has never run it."""
    rights = {"HOME": str(folder), "XDG_RUNTIME_DIR": str(folder), "XDG_DATA_HOME": str(folder / "data")}
    process = subprocess.Popen(
        command("demo", robot, "--no-open"),
        env={**os.environ, **rights}, cwd=folder, stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stderr is not None
    try:
        line = process.stderr.readline()
        while "contid: panel: http" not in line:
            assert process.poll() is None, line
            line = process.stderr.readline()
        url = line.partition("panel: ")[2].strip()
        yield (
            PanelProcess(process, url, int(url.split(":")[2].partition("/")[0]), url.partition("#")[2]),
            process,
        )
    finally:
        process.terminate()
        process.communicate(timeout=30)


class Visit:
    """One visitor at one page.

    Attributes:
        found: barriers that axe-core finds, text without contrast, and parts wider than the screen.
    """

    def __init__(self, it: OpenPage, client: Client, process: subprocess.Popen[str], pictures: str) -> None:
        self.it, self.page, self.client, self.process = it, it.page, client, process
        self.found: list[str] = []
        self._pictures, self._shots = pictures, 0
        self.robot = self.page.locator(".robot").first
        self.name = str(self.robot.get_attribute("data-robot"))
        self.columns = columns_of(client.describe())[self.name]

    def seen(self, step: str) -> None:
        """Look at the page."""
        self.found += [f"{step}: {text}" for text in (*violations(self.it), *dim(self.it))]
        wide = self.page.evaluate("document.documentElement.scrollWidth - window.innerWidth")
        if wide > 0:
            self.found.append(f"{step}: the page is {wide} px wider than the screen")
        if self._pictures:
            self._shots += 1
            self.page.screenshot(path=f"{self._pictures}-{self._shots:02}-{step}.png", full_page=True)

    def state(self, state: str) -> None:
        self.it.state(self.name, state)

    def command(self) -> list[float]:
        """The commanded axes."""
        axes = self.client.status()["robots"][self.name]["axes"].values()
        return [next(axis[key] for key in axis if key.startswith("command_")) for axis in axes]

    def moves(self, what: str, act: Any) -> None:
        """Do something; the robot moves by it, and holds in the end."""
        before = self.command()
        act()
        until(lambda: self.command() != before, f"{what} has moved {self.name}")
        self.state(ARMED)

    def entry(self, number: int) -> Locator:
        """The field of an axis in which numbers are typed."""
        return self.robot.locator("fieldset").last.locator("input.entry").nth(number)

    # -- what a visitor does --

    def watches(self) -> None:
        """The robots move by themselves, and the plots have curves."""
        self.state(MOVES_ITSELF)
        before = self.command()
        until(lambda: self.command() != before, "the demonstration moves")
        self.page.locator("#lease").get_by_text("Demonstration").wait_for()

    def takes_over(self) -> None:
        """A touch ends the demonstration; a page that stood still, as while it is examined, lost it."""
        if self.page.locator("#lease").get_by_text("Demonstration").count():
            self.robot.locator("h2").click()
        elif self.page.locator("#lease[data-mine=false]").count():
            self.page.get_by_role("button", name="Take control").click()
        self.page.wait_for_selector("#lease[data-mine=true]")

    def jogs(self) -> None:
        slider = self.robot.locator("fieldset").last.locator("input[type=range]").first
        slider.focus()
        for _ in range(3):
            self.page.keyboard.press("ArrowRight")

    def types(self) -> None:
        middle = 0.5 * (self.columns.minimum[0] + self.columns.maximum[0])
        share = self.command()[0] + 0.1 * (middle - self.command()[0]) + 0.01
        self.entry(0).fill(f"{share:.3f}")
        self.entry(0).press("Enter")

    def drags_the_ball(self) -> None:
        """Look for the ball by its colour, take it where the pointer becomes a hand."""
        view = self.page.locator("#view")
        view.scroll_into_view_if_needed()
        red, green, blue = np.moveaxis(imread(io.BytesIO(view.screenshot()), format="png")[..., :3], -1, 0)
        rows, columns = np.nonzero((red > 0.75) & (green < 0.45) & (blue < 0.5) & (blue > green))
        box = view.bounding_box()
        assert box is not None
        for row, column in zip(rows, columns, strict=True):
            at = (box["x"] + float(column), box["y"] + float(row))
            self.page.mouse.move(*at)
            if self.page.evaluate("document.getElementById('view').style.cursor") == "grab":
                break
        else:
            pytest.fail("no ball under the pointer")
        self.page.mouse.down()
        self.page.mouse.move(at[0] + 6, at[1] + 6, steps=3)
        self.page.wait_for_timeout(200)
        self.page.mouse.up()

    def saves_a_pose(self) -> None:
        self.page.get_by_label("Name of the pose").fill("first")
        self.page.get_by_role("button", name="Save pose").click()
        self.page.get_by_role("button", name="Go to first").wait_for()

    def goes_to_the_pose(self) -> None:
        self.page.get_by_role("button", name="Go to first").click()

    def plays_a_trajectory(self) -> None:
        """From where it is a hundredth of the range towards the middle, in a second."""
        here = self.command()
        there = [
            at + 0.02 * (0.5 * (low + high) - at)
            for at, low, high in zip(here, self.columns.minimum, self.columns.maximum, strict=True)
        ]
        rows = [[0.0, *here], [1.5, *there]]
        text = "\n".join([",".join(["t_s", *self.columns.axes]), *(",".join(map(repr, row)) for row in rows)])
        self.page.set_input_files(
            "#trajectory input",
            {"name": "little.csv", "mimeType": "text/csv", "buffer": text.encode()},
        )
        self.page.wait_for_selector("#trajectory .good, #trajectory .bad")
        assert self.page.locator("#trajectory .bad").count() == 0, self.it.text("#trajectory")
        self.page.locator("#trajectory button:enabled").click()

    def records(self) -> None:
        self.page.get_by_role("button", name="Record", exact=True).click()
        self.page.wait_for_selector("#recording li.live")

    def ends_the_recording(self) -> None:
        self.page.get_by_role("button", name="End recording").click()
        self.page.wait_for_selector("#recording li.live", state="detached")

    def suspends_the_machine(self) -> None:
        """The process that moves robots stands still, for longer than its devices allow."""
        children = psutil.Process(self.process.pid).children()
        (moving,) = (each for each in children if "contid.control.process" in each.cmdline())
        moving.send_signal(signal.SIGSTOP)
        self.page.wait_for_timeout(300)
        moving.send_signal(signal.SIGCONT)
        self.state(FAULT)
        self.page.get_by_role("alert").filter(has_text=f"{self.name}: fault").wait_for()

    def clears_the_fault(self) -> None:
        for button in self.page.get_by_role("button", name="Clear fault").all():
            if button.is_visible():
                button.click()
        self.robot.get_by_role("button", name="Resume").click()
        self.state(ARMED)

    def stops(self) -> None:
        self.page.locator("#stop").click()
        self.state(OFF)
        self.page.locator(".toast").get_by_text("may sink").first.wait_for()


def visit(
    browser: Browser, robot: str, folder: Path, scheme: Literal["light", "dark"], width: int, draws: bool
) -> list[str]:
    """The whole visit, the ball where the browser draws; the barriers that were met."""
    keys = {"viewport": {"width": width, "height": 844 if width < 600 else 860}, "color_scheme": scheme}
    pictures = os.environ.get("CONTID_VISIT_PICTURES", "")
    name = f"{pictures}/{robot}-{width}-{scheme}" if pictures else ""
    with (
        demo(robot, folder) as (served, process),
        opened(browser, served, **keys) as it,
        Client(next(folder.rglob("*.sock"))) as client,
    ):
        it.page.wait_for_selector(".robot")
        visitor = Visit(it, client, process, name)
        visitor.watches()
        visitor.seen("demo")
        visitor.takes_over()
        visitor.moves("the slider", visitor.jogs)
        visitor.seen("jogged")
        visitor.takes_over()
        visitor.moves("the number", visitor.types)
        visitor.records()
        visitor.saves_a_pose()
        if draws:
            visitor.moves("the ball", visitor.drags_the_ball)
        visitor.moves("the pose", visitor.goes_to_the_pose)
        visitor.moves("the trajectory", visitor.plays_a_trajectory)
        visitor.ends_the_recording()
        visitor.seen("played")
        visitor.suspends_the_machine()
        visitor.seen("fault")
        visitor.takes_over()
        visitor.clears_the_fault()
        visitor.stops()
        visitor.seen("stopped")
        return visitor.found


def test_a_first_visit(browser: Browser, tmp_path: Path) -> None:
    assert visit(browser, "catheter", tmp_path, "light", 390, draws=False) == []


@pytest.mark.campaign
@pytest.mark.parametrize("width", [390, 1280])
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("robot", ROBOTS)
def test_every_first_visit(
    drawing: Browser, tmp_path: Path, robot: str, scheme: Literal["light", "dark"], width: int
) -> None:
    assert visit(drawing, robot, tmp_path, scheme, width, draws=True) == []
