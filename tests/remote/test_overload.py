"""An overload in `status` and in what clients get: fewer frames, one warning for each change."""

from __future__ import annotations

from typing import Any, cast

import pytest

from contid.control.engine.events.buses import TELEMETRY_HZ, OverloadChanged, TicksSkipped
from contid.remote.server.query_handler import QueryHandler, Subscription


def _changed(level: int, rate_hz: float) -> OverloadChanged:
    return OverloadChanged(level=level, rate_hz=rate_hz, full_rate_hz=200.0, work_ms=7.5)


def test_an_overload_thins_telemetry_until_it_is_over_and_each_change_is_a_warning() -> None:
    nothing = cast("Any", None)
    queries = QueryHandler(nothing, nothing, nothing, nothing, lambda: 0, nothing, None)
    skips = TicksSkipped(ticks=3, total=9)
    for event in (skips, _changed(1, 200.0), skips, _changed(2, 100.0), skips, skips):
        queries.notice(event)
    assert queries.telemetry_hz == TELEMETRY_HZ
    subscription = Subscription(100.0, ("finger",), (), events=False)
    subscription.sent(10.0, 1, queries.telemetry_hz)
    assert not subscription.due(10.0 + 0.9 / TELEMETRY_HZ, 0.005)
    assert subscription.due(10.0 + 1.0 / TELEMETRY_HZ, 0.005)
    queries.notice(_changed(0, 200.0))
    subscription.sent(11.0, 2, queries.telemetry_hz)
    assert subscription.due(11.0 + 0.01, 0.005)
    reported = [warning["message"] for warning in queries._warnings]
    changes = [_changed(1, 200.0), _changed(2, 100.0), _changed(0, 200.0)]
    assert reported == [str(each) for each in (skips, changes[0], skips, changes[1], skips, changes[2])]
    assert "100 of 200 Hz" in reported[3]


@pytest.mark.parametrize(("level", "words"), [(0, "fit again"), (1, "5 frames"), (2, "1/2 of its speed")])
def test_an_overload_names_what_gives_way(level: int, words: str) -> None:
    assert words in str(_changed(level, 200.0 / max(1, level)))
