"""Rows of a live stream for several robots: what one is refused does not hold the others."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.preflight.rows import Preflight
from contid.remote.server.live_rows import LiveRows
from contid.robot_file.load import load_named
from contid.trajectory.rows import RowReader


def test_a_robot_goes_along_its_edge_where_another_is_refused() -> None:
    loaded = load_named("hand")
    configs = {each.name: each for each in build_robot_configs(loaded, 200.0)}
    # The left finger stands straight at its full length of 122 mm, the edge of its reach.
    commands = {"left": configs["left"].model.upper, "right": configs["right"].rest}
    view: Any = SimpleNamespace(configs=configs, command=lambda name, record: commands[name])
    preflight = SimpleNamespace(
        refuses=True,
        unreachable=lambda row, record: Preflight(tuple(configs.values()), seeds=commands).row(row),
    )
    rows = LiveRows(view, preflight)  # type: ignore[arg-type]
    reader = RowReader("left.x_mm,left.y_mm,right.x_mm,right.y_mm", "stream", loaded.driven)
    aside = (1.0, 123.0)
    found = {}
    for case, right in (("both in reach", (100.0, 82.0)), ("right out of reach", (1000.0, 82.0))):
        move: Any = SimpleNamespace(count=0, reader=reader, nearest=True, last={})
        found[case] = rows.check(move, (*aside, *right), None)
    alone, beside = found.values()
    assert alone.targets["left"] is not None
    assert alone.refused == []
    assert beside.targets == {"left": alone.targets["left"], "right": None}
    assert beside.reached == alone.reached
    assert len(beside.refused) == 1
    assert beside.refused[0].startswith("rows:1: right: tip (1000, 82, 0) mm is out of reach")
