"""Jogging at a part of full speed: what was refused before, and columns without a speed, do not hold it."""

from __future__ import annotations

from itertools import pairwise

import pytest

pytest.importorskip("playwright.sync_api", reason="pip install 'contid[test]'")

from playwright.sync_api import Page

pytestmark = [pytest.mark.process, pytest.mark.realtime]

#: The rows of half a second of a walk at half speed, of a robot at 0, 0 whose second column has no speed.
WALKED = """async ([refusal, goal]) => {
    const { Walk } = await import('/static/walk.js');
    const rows = [], refusals = new Map(refusal ? [['f0', refusal]] : []);
    const jog = {
        refusals, active: null,
        to(robot, columns, values) { rows.push(values); this.active = robot; refusals.delete(robot); },
        end() { this.active = null; }, ordered() { return null; }, arrived() {},
    };
    const walk = new Walk({}, jog, { share: 0.5 }), columns = ['a', 'b'];
    walk.know(columns, [10, 0], () => [0, 0]);
    walk.to('f0', columns, goal);
    await new Promise((done) => setTimeout(done, 500));
    return [rows, refusals.get('f0') ?? ''];
}"""


@pytest.mark.parametrize("refusal", ["", "a is at the end of its range"])
def test_a_refusal_does_not_hold_what_is_ordered_next(idle: Page, refusal: str) -> None:
    """Below full speed every slider was dead after a refusal, until another button was pressed."""
    rows, left = idle.evaluate(WALKED, [refusal, [1.0, 0.0]])
    assert rows[-1] == [1.0, 0.0]
    assert all(after[0] >= before[0] for before, after in pairwise(rows))
    assert left == ""


def test_a_column_without_a_speed_is_refused_with_its_reason(idle: Page) -> None:
    """As the azimuth of a planar arm: the robot was ordered where it is for ever."""
    rows, left = idle.evaluate(WALKED, ["", [1.0, 5.0]])
    assert rows == []
    assert left.startswith("b has no speed")
