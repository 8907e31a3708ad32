"""Modules of the page alone: the way of a jog below full speed, a slider that is disabled, a plot."""

from __future__ import annotations

import pytest

pytest.importorskip("playwright.sync_api", reason="pip install 'contid[test]'")

from playwright.sync_api import Page

pytestmark = [pytest.mark.process, pytest.mark.realtime]

#: Azimuths of the rows of a walk from 170 to -170 degrees at half of 90 degrees a second, every 50 ms.
WALKED = """async () => {
    const { Walk } = await import('/static/walk.js');
    const rows = [], really = performance.now;
    let now = 1000;
    performance.now = () => now;
    const jog = { refusals: new Map(), active: 'arm', to: (robot, columns, values) => rows.push(values[1]),
                  ordered: () => null, end: () => {} };
    const walk = new Walk({ ordered: () => {} }, jog, { share: 0.5 });
    const columns = ['s1.bend_deg', 's1.azimuth_deg'];
    walk.know(columns, [20, 90], () => [40, 170]);
    walk.to('arm', columns, [40, -170]);
    for (let i = 0; i < 40 && rows.at(-1) !== -170; i++) { now += 50; walk.step(); }
    performance.now = really;
    return rows;
}"""


def test_an_azimuth_walks_the_short_way(idle: Page) -> None:
    rows = idle.evaluate(WALKED)
    assert rows[-1] == -170
    assert len(rows) == pytest.approx(20.0 / (45.0 * 0.05), abs=2.0)
    assert all(170.0 <= row % 360.0 <= 190.0 for row in rows)


#: A slider under a hand, what it shows once it was disabled, and how often the hand was off.
DISABLED = """async () => {
    const { Slider } = await import('/static/slider.js');
    let now = 1000, off = 0;
    const really = performance.now;
    performance.now = () => now;
    const hand = { moved: () => {}, ended: () => { off++; } };
    const slider = new Slider('x', 0, 100, 'mm', hand);
    slider.input.dispatchEvent(new Event('pointerdown'));
    slider.input.value = 80;
    slider.input.dispatchEvent(new Event('input'));
    slider.disable(true);
    slider.disable(true);
    now += 2000;
    slider.show(20, null, []);
    performance.now = really;
    return [slider.input.value, slider.number.value, off];
}"""


def test_a_slider_that_is_disabled_under_a_hand_shows_where_the_robot_is(idle: Page) -> None:
    assert idle.evaluate(DISABLED) == ["20", "20.0", 1]


#: Title and names of the plot of the axes of a robot with a wrist.
TITLED = """async () => {
    const { Plots } = await import('/static/plots/plots.js');
    const axes = { left: { min_mm: 0, max_mm: 50 }, wrist: { min_deg: -90, max_deg: 90 } };
    const robots = { arm: { unit: 'mm', axes } };
    const history = { axes: ['left', 'wrist'] };
    const [title, curves] = Plots.prototype.what.call({ robots, robot: 'arm' }, 'axes', history, 300);
    return [title, ...curves.map((each) => each.name)];
}"""


def test_a_plot_has_the_unit_of_every_axis(idle: Page) -> None:
    assert idle.evaluate(TITLED) == [
        "Axes [mm, deg], dashed: command", "left [mm]", "wrist [deg]", "left [mm]", "wrist [deg]",
    ]  # fmt: skip
