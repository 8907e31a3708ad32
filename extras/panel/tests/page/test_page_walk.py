"""The way of a jog below full speed, by the module of the page alone."""

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
