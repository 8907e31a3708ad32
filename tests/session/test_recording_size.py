"""The predicted size of recordings is that of recordings of moving robots."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from contid import Sim
from contid.control.engine.cycle import Sink
from contid.control.engine.virtual import Tee
from contid.robot_file.load import load_named, with_mock
from contid_sessions.recording_size import predicted_size


def _moved(sim: Sim, ticks: int) -> None:
    for k in range(ticks):
        sim.step({"x_mm": 10.0 * math.cos(0.008 * k), "y_mm": 80.0 + 10.0 * math.sin(0.008 * k)})
    sim.close()


def test_a_prediction_is_the_size_of_a_recording_of_the_same_motion(tmp_path: Path) -> None:
    loaded = with_mock(load_named("finger"))

    def run(sink: Sink) -> None:
        sim = Sim("finger")
        sim._sink = Tee([sim, sink])  # no recording of its own
        sim.reset()
        _moved(sim, 300)

    size = predicted_size(loaded, 200.0, run)
    path = tmp_path / "long.mcap"
    _moved(Sim("finger", record=path), 1500)
    hours = 1500 / 200.0 / 3600.0
    assert size.complete == pytest.approx(path.stat().st_size / hours, rel=0.35)
    assert 3.0 < size.growing / size.complete < 10.0
    assert f"{size.growing / 1e9:.2g} GB per hour" in str(size)
