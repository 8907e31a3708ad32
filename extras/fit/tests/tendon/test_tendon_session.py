"""Rows of a session whose tracker needs longer than a tick."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace as Record

import numpy as np
import pytest

from contid.robot_file.load import load_named
from contid_fit.commands import tendon_session


@pytest.mark.parametrize("skipped", [0, 40])
def test_late_tips_are_rows_with_the_pulls_of_their_capture(
    monkeypatch: pytest.MonkeyPatch, skipped: int
) -> None:
    """Ticks of 5 ms; a tip every 20 ms that arrives after 30 ms; its x is the first pull at its capture.

    Skipped ticks do not advance the age of a tip, which has the time of the robots.
    """
    period_s, ticks = 0.005, []
    for k in range(400):
        before = skipped if k >= 201 else 0
        t_s = (k + before) * period_s
        captured = 4 * ((k - 6) // 4)  # newest tip that has arrived by then
        tip = (captured * 1e-4, 0.0, 0.1) if captured >= 0 else (math.nan,) * 3
        late = skipped if captured < 201 <= captured + 6 else 0  # arrived behind the skipped ticks
        age_s = (k - captured + late) * period_s if captured >= 0 else math.nan
        axes = [Record(command=k * 1e-4) for _ in range(9)]
        ticks.append(
            Record(
                tick=k + before,
                skipped=before,
                deadline_s=t_s,
                robots=[Record(axes=axes, measured_tip_m=tip, measured_age_s=age_s)],
            )
        )
    session = Record(
        layout=Record(robots=[Record(name="arm", axes=("a",))]),
        robot_file=lambda: load_named("tendon3"),
        rate_hz=200.0,
        ticks=lambda: ticks,
    )
    monkeypatch.setattr(tendon_session, "Session", lambda path: session)
    found = tendon_session.session_recording(Path("late.mcap"), "arm")
    assert len(found) > 30
    assert np.allclose(found.pull_m[:, 0], found.tip_m[:, 0], atol=1e-9)
