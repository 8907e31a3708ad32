"""Drawing never keeps a press of STOP: how seldom the page draws where that takes long."""

from __future__ import annotations

import pytest

pytest.importorskip("playwright.sync_api", reason="pip install 'contid[test]'")

from playwright.sync_api import Page

from tests.support.browser import OpenPage
from tests.support.daemons import Running
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime]

#: A pace with a clock of its own; `image(step)` draws once, and the images asked for come every `step` ms.
PACED = """async (work) => {
    const { Pace } = await import('/static/pace.js');
    let now = 1000, asked = null;
    const pace = new Pace(() => now, (then) => { asked = then; });
    const come = (step) => { const then = asked; asked = null; now += step; then(); };
    const image = (step) => { pace.begin(); while (asked) come(step); };
    const later = (ms) => { now += ms; };
    return new Function('pace', 'image', 'come', 'later', work)(pace, image, come, later);
}"""


def paced(page: Page, work: str) -> object:
    """The value of a script with `pace`, `image`, `come` and `later`."""
    return page.evaluate(PACED, work)


def test_quick_images_are_never_waited_for(idle: Page) -> None:
    work = (
        "const out = []; for (let i = 0; i < 9; i++) { image(1000 / 60); out.push(pace.wait()); } return out"
    )
    assert paced(idle, work) == [0] * 9


def test_a_screen_that_is_refreshed_seldom_is_no_slow_one(idle: Page) -> None:
    assert paced(idle, "image(1000 / 24); image(1000 / 24); return pace.wait()") == 0


def test_the_pause_grows_with_what_images_take_and_ends_with_it(idle: Page) -> None:
    pauses = paced(
        idle,
        "image(16); const out = [pace.wait()];"
        "for (const step of [40, 80, 900, 16]) { image(step); out.push(pace.wait()); } return out",
    )
    assert pauses == [0, 4 * 3 * 40, 4 * 3 * 80, 2000, 0]


def test_images_that_never_come_are_given_up(idle: Page) -> None:
    work = (
        "image(16); image(80); later(960); pace.begin(); later(2000); const first = pace.wait();"
        "pace.begin(); return [first, pace.wait(), pace.measuring]"
    )
    assert paced(idle, work) == [0, 2000, True]
    assert paced(idle, "pace.begin(); pace.forget(); come(16); return [pace.wait(), pace.measuring]") == [
        0,
        False,
    ]


def test_where_a_program_draws_images_are_apart(idle: Page) -> None:
    assert paced(idle, "pace.software = true; image(16); return pace.wait()") == 250


def test_a_new_state_is_written_although_its_image_waits(it: OpenPage, running: Running) -> None:
    """No image comes and the clock of the page stands, so that the pause before the next one never ends."""
    it.page.evaluate(
        "() => { window.requestAnimationFrame = () => 0;"
        "const now = performance.now(); performance.now = () => now; }"
    )
    it.page.wait_for_timeout(500)  # frames come meanwhile
    it.page.keyboard.press("Space")
    until(running.off, "the devices are without torque")
    it.state("f0", "OFF")


@pytest.mark.parametrize("by", ["pointer", "key"])
def test_stop_although_nothing_is_drawn(it: OpenPage, running: Running, by: str) -> None:
    box = it.page.locator("#stop").bounding_box()
    assert box is not None
    it.page.evaluate("() => { window.requestAnimationFrame = () => 0; }")
    if by == "pointer":
        it.page.mouse.move(box["x"] + 20.0, box["y"] + 20.0)
        it.page.mouse.down()
    else:
        it.page.keyboard.press("Space")
    until(running.off, "the devices are without torque")
    it.state("f0", "OFF")  # shown although the images of the page never come
