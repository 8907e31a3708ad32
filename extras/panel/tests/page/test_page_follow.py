"""The page in a real browser: what a body does beside what it should do, and how far its bring-up is."""

from __future__ import annotations

from typing import Final

import pytest

pytest.importorskip("playwright.sync_api", reason="pip install 'contid[test]'")
pytest.importorskip("axe_playwright_python", reason="pip install 'contid[test]'")

from contid.robot_file.load import parse_robot_file
from contid.robot_file.proven.bringup import wiring_digest
from tests.support.browser import OpenPage, Tab, dim, violations
from tests.support.daemons import daemon
from tests.support.panels import panel
from tests.support.waiting import until

#: Leases lapse in real time, and the browser shares the cores.
pytestmark = [pytest.mark.process, pytest.mark.realtime]

#: The encoder of one axis stands still, and one follows its servo only by more than 6 degrees, 0.63 mm.
FAULTS: Final = """faults:
  - {at_s: 0.1, kind: scaled, share: 0, axis: f0.left}
  - {at_s: 0.1, kind: play, by_deg: 6, axis: f1.left}
"""


def brought_up(text: str) -> str:
    """The same robots: one axis is proven, one was wired anew; simulated ones have no bring-up."""
    (bus,) = parse_robot_file(text, "fingers.yaml").buses.values()
    entry = "  {}: {{date: '2026-11-20', verdict: ok, wiring: {}, device: {}, firmware: '1.7.0'}}\n"
    proven = entry.format("f0.left", wiring_digest(bus, "f0.left"), "board-7")
    return f"{text}\nbringup:\n{proven}{entry.format('f0.right', '0123456789ab', 'board-8')}"


def row(it: OpenPage, robot: str, name: str) -> list[str]:
    """The cells of a line: off its command, off what is expected, what is allowed."""
    line = it.page.locator(
        f".robot[data-robot={robot}] .follow tr", has=it.page.get_by_role("rowheader", name=name)
    )
    return [text.replace("−", "-") for text in line.locator("td").all_inner_texts()]


def go(it: OpenPage, robot: str, axis: str, value: str) -> None:
    """Type where an axis goes."""
    entry = it.page.locator(f".robot[data-robot={robot}]").get_by_role(
        "textbox", name=f"{axis} in mm, number"
    )
    entry.fill(value)
    entry.press("Enter")


def test_a_body_beside_its_commands_and_its_bring_up(tab: Tab) -> None:
    with (
        daemon(2, options=FAULTS, change=brought_up) as running,
        panel(running) as served,
        tab.opened(served) as it,
    ):
        for robot in ("f0", "f1"):
            it.state(robot, "HOLD")
            assert it.text(f".robot[data-robot={robot}] .follow caption span") == "follows"
        # Bring-up: by robot, then by axis with its device; what is to be done.
        card = it.text("#bringup")
        for part in (
            "f0: 1 of 2 axes proven, slow until right is",
            "f1: nothing to bring up, sim devices have no bring-up",
            "2026-11-20; device board-7, firmware 1.7.0",
            "its wiring in this file was changed since its bring-up, 2026-11-20; f0 moves at 20%",
            f"contid bringup {running.folder}/fingers.yaml",
        ):  # fmt: skip
            assert part in card
        # An axis with play ends before its command by half of it, within what is allowed.
        it.take_control()
        go(it, "f1", "left", "55")
        until(
            lambda: float(row(it, "f1", "left")[1]) == pytest.approx(-0.63, abs=0.03),
            "it ends before its command",
        )
        until(lambda: len(set(row(it, "f1", "left")[:2])) == 1, "it stands still")
        assert row(it, "f1", "left")[2] == "±1 mm"
        assert [float(each) for each in row(it, "f1", "right")[:2]] == pytest.approx([0.0, 0.0], abs=0.03)
        off_mm = float(row(it, "f1", "tip")[0].removesuffix(" mm"))
        with running.client() as client:
            frame = next(iter(client.telemetry(20.0, fields=("tip_mm", "command_tip_mm"))))["robots"]["f1"]
        away = [a - b for a, b in zip(frame["tip_mm"], frame["command_tip_mm"], strict=True)]
        assert off_mm == pytest.approx(sum(each**2 for each in away) ** 0.5, abs=0.1)
        # One that stands still is outside when the robot stops; that stays until the fault is cleared.
        go(it, "f0", "left", "70")
        it.state("f0", "FAULT")
        it.page.locator("[data-robot=f0] .follow caption", has_text="at the fault: left outside").wait_for()
        _, expected, allowed = row(it, "f0", "left")
        assert float(expected) < -1.0
        assert allowed == "outside ±1 mm"
        # A page with a fault, in light and dark, on a phone and on a large screen.
        it.page.wait_for_selector("#faults:not([hidden])")
        found = []
        for scheme, width in (("light", 390), ("dark", 1280)):
            it.page.emulate_media(color_scheme=scheme)  # type: ignore[arg-type]
            it.page.set_viewport_size({"width": width, "height": 844})
            it.page.wait_for_timeout(300)
            found += [*violations(it), *dim(it)]
        assert found == []
