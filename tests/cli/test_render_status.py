"""Bars of `contid status`."""

from __future__ import annotations

from contid.cli.support.render_status import BAR, bar


def test_bars_stay_within_their_width() -> None:
    assert [len(bar(value, 0.0, 10.0)) for value in (None, -5.0, 0.0, 5.0, 10.0, 50.0)] == [BAR] * 6
    assert bar(5.0, 0.0, 10.0).count("█") == BAR // 2
