"""Parts of the page that need no browser: its modules, on elements that only keep what they get."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

STATIC = Path(__file__).parents[1] / "contid_panel" / "static"
ELEMENTS = """
class Element {
  constructor() { Object.assign(this, { children: [], hidden: false, className: "", own: "" }); }
  append(...children) { this.children.push(...children); }
  replaceChildren(...children) { this.children = children; }
  setAttribute() {}
  addEventListener() {}
  get textContent() { return this.children.map((each) => each.textContent ?? each).join("") || this.own; }
  set textContent(text) { this.children = []; this.own = text; }
}
const byId = {};
globalThis.document = {
  createElement: () => new Element(), getElementById: (id) => byId[id] ??= new Element(),
};
"""
pytestmark = [
    pytest.mark.process,
    pytest.mark.skipif(shutil.which("node") is None, reason="needs node"),
]


def run(code: str) -> Any:
    """What a module prints as JSON; ``load`` imports a file of the page."""
    load = f"const load = (name) => import({json.dumps(STATIC.as_uri())} + '/' + name);"
    done = subprocess.run(
        ["node", "--experimental-default-type=module", "--input-type=module", "-e", ELEMENTS + load + code],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_an_axis_that_pushes_is_named_and_nothing_is_marked_when_nothing_is_known() -> None:
    shown = run("""
    const { Follow } = await load("follow.js");
    const follow = new Follow({ a: "mm", b: "mm" }, { a: { tolerance_mm: 1 }, b: { tolerance_mm: 1 } });
    const tips = { tip_mm: [0, 0, 1], command_tip_mm: [0, 0, 0], measured_tip_mm: null };
    const show = (pushes) => follow.show({
      measured: [5, 0], command: [0, 0], ...tips, expected: { off: [4, 3], pushes, at_fault: false },
    });
    const [first] = follow.axes;
    const state = () => [follow.summary.textContent, first.element.className, first.mark.textContent];
    const out = [];
    for (const pushes of [[false, false], [true, false], [true, true]]) { show(pushes); out.push(state()); }
    show([false, false]); follow.lost(); out.push(state());
    console.log(JSON.stringify(out));
    """)
    assert shown == [
        ["a, b outside", "outside", "outside "],
        ["b outside; a pushes", "pushes", "pushes "],
        ["a, b push", "pushes", "pushes "],
        ["not known", "", ""],
    ]


def test_a_longer_time_is_shown_live_and_no_time_before_the_history() -> None:
    ends = run("""
    const { Timespan } = await load("plots/timespan.js");
    const { HISTORY_S } = await load("plots/history.js");
    const out = {};
    let it = new Timespan(() => {});
    it.advance(0); it.advance(100);
    it.zoom(1.6, 0.5); out.zoomed_out = it.end_s;
    it.zoom(0.5, 0.5); out.zoomed_in = it.end_s;
    it.goLive(); it.advance(HISTORY_S + 200); it.shift(-2 * HISTORY_S); out.earliest = it.window.from - 200;
    it.shift(HISTORY_S); out.later = it.end_s;
    it = new Timespan(() => {});
    it.advance(50); it.advance(52); it.shift(-5); out.short = it.end_s;
    it.advance(3); it.advance(4); it.shift(-1); out.again = it.end_s;
    it.advance(80); it.goLive(); it.shift(-5); out.enough = it.end_s;
    console.log(JSON.stringify(out));
    """)
    assert ends["zoomed_in"] < 100.0
    assert {**ends, "zoomed_in": 0} == {
        "zoomed_out": None, "zoomed_in": 0, "earliest": 0, "later": None,
        "short": 51, "again": 3.5, "enough": 75,
    }  # fmt: skip


def test_bring_up_names_what_is_slow_and_gives_a_command_that_can_be_copied() -> None:
    text = run("""
    const { BringupCard } = await load("bringup.js");
    const card = new BringupCard();
    const found = { message: "m", date: "d", device: "1", firmware: "2", bus: "b", driver: "due" };
    const states = { x: "changed", y: "pending", z: "proven" };
    const entries = Object.entries(states).map(([axis, state]) => [axis, { ...found, state }]);
    const bringup = Object.fromEntries(entries);
    card.describe({ file: "/home/u/my robot's/arm.yaml", robots: { old: {}, arm: { bringup } } });
    const parts = [card.body.textContent];
    card.describe({ file: "/home/u/arm.yaml", robots: { arm: { bringup: { y: bringup.y } } } });
    console.log(JSON.stringify([...parts, card.body.textContent]));
    """)
    assert "old: not known, the daemon is of an earlier version" in text[0]
    assert "arm: 1 of 3 axes proven, slow until x is" in text[0]
    assert text[0].endswith("contid bringup '/home/u/my robot'\\''s/arm.yaml'")
    assert "arm: 0 of 1 axes proven" in text[1]
    assert "slow" not in text[1]
    assert text[1].endswith("contid bringup /home/u/arm.yaml")
