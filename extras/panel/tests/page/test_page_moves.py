"""The page in a real browser: jogging, dragging, trajectories, poses, recordings."""

from __future__ import annotations

import io
import math
from pathlib import Path
from typing import Final

import numpy as np
import pytest
from matplotlib.image import imread

pytest.importorskip("playwright.sync_api", reason="pip install 'contid[test]'")

from contid.kinematics.array import Array
from tests.support.browser import OpenPage, Tab, tip_mm
from tests.support.command import contid_in
from tests.support.daemons import Running, armed_daemon, states
from tests.support.panels import panel
from tests.support.waiting import until

#: Leases lapse in real time, and the browser shares the cores.
pytestmark = [pytest.mark.process, pytest.mark.realtime]


OBSTACLES: Final = """
clearance:
  bodies:
    f0: {radius_mm: 8}
  obstacles:
    crate: {box: {center_mm: [-100, 60, 0], size_mm: [40, 30, 20], yaw_deg: 30}}
    ball: {sphere: {center_mm: [110, 60, 0], radius_mm: 20}}
"""


def colours(it: OpenPage) -> Array:
    """Red, green and blue of the view, each (height, width), from 0 to 1."""
    shot = io.BytesIO(it.page.locator("#view").screenshot())
    return np.moveaxis(imread(shot, format="png")[..., :3], -1, 0)


def brown_pixels(image: Array) -> int:
    """Pixels in the colour of obstacles."""
    red, green, blue = image
    hue = (red > green + 0.06) & (green > blue + 0.02) & (red < blue + 0.33)
    return int(np.count_nonzero(hue & (red < 0.75)))


def commanded(running: Running, name: str) -> float:
    """Where f0 is commanded to [mm]: what is measured still follows when a motion has ended."""
    with running.client() as client:
        fields = next(iter(client.telemetry(20.0, fields=("command", "command_tip_mm"))))["robots"]["f0"]
    (left, right), (x, y, *_) = fields["command"], fields["command_tip_mm"]
    return float({"x": x, "y": y, "left": left, "right": right}[name])


def test_jog_along_every_axis(it: OpenPage, running: Running) -> None:
    names, others = ("x", "y", "left", "right"), tip_mm(running, "f1")
    sliders = {name: it.page.locator(it.slider("f0", name)) for name in names}
    assert all(slider.is_disabled() for slider in sliders.values())
    it.take_control()
    for name, slider in sliders.items():
        it.page.wait_for_selector(it.slider("f0", name) + ":enabled")
        goal = commanded(running, name) - 1.9
        slider.focus()
        for _ in range(20):
            it.page.keyboard.press("ArrowLeft")
        until(lambda name=name, goal=goal: it.value("f0", name) < goal, f"{name} has moved")  # type: ignore[misc]
        it.state("f0", "HOLD")
        assert tip_mm(running, "f1") == pytest.approx(others, abs=0.1)


def test_a_jog_out_of_reach_is_refused_with_a_message(it: OpenPage, running: Running) -> None:
    it.take_control()
    slider = it.page.locator(it.slider("f0", "y"))
    box = slider.bounding_box()
    assert box is not None
    middle = box["y"] + box["height"] / 2
    it.page.mouse.move(box["x"] + box["width"] * 0.7, middle)
    it.page.mouse.down()
    it.page.mouse.move(box["x"] + box["width"] - 1, middle, steps=4)
    x_slider = it.page.locator(it.slider("f0", "x"))
    it.page.mouse.up()
    box = x_slider.bounding_box()
    assert box is not None
    it.page.mouse.move(box["x"] + 2, box["y"] + box["height"] / 2)
    it.page.mouse.down()
    note = it.page.locator(".robot[data-robot=f0] .refused")
    note.filter(has_text="out of reach").wait_for()
    it.page.mouse.up()
    it.state("f0", "HOLD")
    it.page.wait_for_timeout(2500)  # the page draws every two seconds at least
    assert "out of reach" in note.inner_text()  # a hand that is off has not read it yet
    slider.focus()
    it.page.keyboard.press("ArrowLeft")
    it.page.wait_for_function("(note) => !note.textContent", arg=note.element_handle(), timeout=10_000)


def test_drag_of_the_target_in_the_view(drawn: OpenPage, running: Running) -> None:
    drawn.take_control()
    canvas = drawn.page.locator("#view").bounding_box()
    assert canvas is not None
    before = tip_mm(running)
    cursor = "() => document.getElementById('view').style.cursor"
    # Look for the target as a person does: where the pointer becomes a hand.
    grid = [(0.045 * i, 0.08 * k) for k in range(2, 11) for i in range(2, 20)]
    for across, down in grid:
        drawn.page.mouse.move(canvas["x"] + across * canvas["width"], canvas["y"] + down * canvas["height"])
        if drawn.page.evaluate(cursor) == "grab":
            break
    else:
        pytest.fail("no target under the pointer")
    drawn.page.mouse.down()
    drawn.page.mouse.move(
        canvas["x"] + across * canvas["width"] + 25, canvas["y"] + down * canvas["height"] + 20, steps=8
    )
    drawn.page.wait_for_timeout(300)
    drawn.page.mouse.up()
    # The page may still show the state of before the motion: the daemon reports when it has ended.
    with running.client() as client:
        until(lambda: states(client) == {"HOLD"}, "every robot holds")
    robot = "f0" if math.dist(tip_mm(running), before) > 1.0 else "f1"
    drawn.state(robot, "HOLD")
    if robot == "f1":
        assert tip_mm(running) == pytest.approx(before, abs=0.1)


def test_the_robots_are_drawn(drawn: OpenPage) -> None:
    """The first robot is blue, the second orange; in a fault both would be red, without torque grey.

    A program that draws in place of a graphics card is noticed: Chromium reports no caveat when it was
    started with one.
    """
    assert drawn.page.locator("#view").get_attribute("data-drawn-by") == "a program"
    assert drawn.page.locator("#view-note").is_hidden()
    red, green, blue = image = colours(drawn)
    assert np.count_nonzero((blue > red + 0.35) & (blue > 0.6)) > 500
    assert np.count_nonzero((red > blue + 0.35) & (green > blue + 0.2)) > 500
    assert brown_pixels(image) < 50


def test_a_trajectory_is_shown_before_it_is_played(it: OpenPage, running: Running) -> None:
    def upload(name: str, text: str) -> None:
        it.page.set_input_files(
            "#trajectory input", {"name": name, "mimeType": "text/csv", "buffer": text.encode()}
        )

    upload("bad.csv", "t_s,f0.x_mm,f0.y_mm\n0,50,75\n1,9000,75\n")
    it.page.wait_for_selector("#trajectory .bad")
    assert "bad.csv:3" in it.text("#trajectory")
    assert it.page.locator("#trajectory button").is_disabled()
    upload("line.csv", "t_s,f0.x_mm,f0.y_mm\n0,50,75\n0.5,45,75\n1,40,75\n")
    it.page.wait_for_selector("#trajectory .good")
    assert it.page.locator("#trajectory button").is_disabled()
    it.take_control()
    it.page.locator("#trajectory button:enabled").click()
    until(lambda: abs(tip_mm(running)[0] - 40.0) < 0.5, "the trajectory has ended")


def test_poses_are_saved_and_gone_to(it: OpenPage, running: Running) -> None:
    poses = it.page.locator("#poses")
    poses.get_by_text("None in fingers.poses.yaml yet.").wait_for()
    assert poses.get_by_role("button", name="Save pose").is_disabled()
    start = tip_mm(running)
    it.take_control()
    it.page.get_by_label("Name of the pose").fill("start")
    it.page.wait_for_selector("#poses [type=submit]:enabled")
    poses.get_by_role("button", name="Save pose").click()
    it.page.wait_for_selector("#poses li")
    assert "contid panel" in (running.folder / "fingers.poses.yaml").read_text()
    with running.client(name="script") as script:
        script.acquire(30.0, takeover=True)
        script.move({"f0.x_mm": start[0] - 8.0, "f0.y_mm": start[1]})
        it.page.wait_for_selector("#lease[data-mine=false]")
        assert poses.get_by_role("button", name="Go to start").is_disabled()
        script.release()
    it.take_control()
    poses.get_by_role("button", name="Go to start").click()
    until(lambda: tip_mm(running) == pytest.approx(start, abs=0.3), "it is where it was saved")
    # The same name again asks first.
    it.page.get_by_label("Name of the pose").fill("start")
    it.page.keyboard.press("Enter")
    it.page.wait_for_selector("#confirm[open]")
    assert "start" in it.text("#confirm")
    it.page.keyboard.press("Escape")


def test_a_recording_is_begun_ended_and_checked_for_playing_it_again(it: OpenPage, running: Running) -> None:
    card = it.page.locator("#recording")
    it.page.wait_for_selector("#recording button:enabled")
    card.get_by_role("button", name="Record").click()
    it.page.wait_for_selector("#recording li.live")
    with running.client() as client:
        (listed,) = client.status()["recordings"]
    assert listed["by"].startswith("panel page")
    assert Path(listed["file"]).name in card.inner_text()
    card.get_by_role("button", name="End recording").click()
    it.page.wait_for_selector("#recording li.live", state="detached")
    done = contid_in(running.folder, "session", "info", listed["file"])
    assert "clean" in done.stdout, done.stdout + done.stderr
    again = card.locator("li", has_text=Path(listed["file"]).name).get_by_text("Again", exact=True)
    again.click()
    it.page.wait_for_selector("#trajectory .good, #trajectory .bad")
    assert "every row and the way between is within reach" in it.page.locator("#trajectory").inner_text()


def test_obstacles_are_drawn(drawing_tab: Tab) -> None:
    with (
        armed_daemon(1, change=lambda text: text + OBSTACLES) as running,
        panel(running) as served,
        drawing_tab.opened(served) as it,
    ):
        it.page.wait_for_selector("#recording button:enabled")
        assert "Nothing is recorded." in it.text("#recording")
        until(lambda: brown_pixels(colours(it)) > 400, "the obstacles are drawn")
