"""Commands and measurements of a recording; what no command moved is not among them."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace as Record

import numpy as np
import pytest

from contid.control.engine.messages import Estop
from contid.control.engine.tick_layout import ENABLED
from contid.robot_file.load import load_named
from contid_identify import recording
from contid_identify.delay_lag import fit_axis
from contid_identify.recording import RobotRecording, read_recording
from contid_library.simulated import Sim

#: Pressures [bar]; the simulated regulators answer with a lag of 50 ms.
MOVES = ((0.2, 0.0, 0.0), (0.6, 0.1, 0.3), (0.3, 0.5, 0.0), (0.7, 0.2, 0.4), (0.1, 0.0, 0.2), (0.5, 0.4, 0.3))


def recorded(folder: Path, *, stopped: bool) -> RobotRecording:
    """An arm whose valves open for three seconds in the middle, where it is stopped."""
    file, session = folder / "arm.yaml", folder / f"{stopped}.mcap"
    file.write_text(load_named("stiffflop1").text.replace("rate_hz: 500", "rate_hz: 100"))
    with Sim(file, record=session) as sim:
        for k, bars in enumerate(MOVES * 2):
            sim.step([*bars], ticks=60 + 13 * k)
            if stopped and k == len(MOVES) - 1:
                sim._obey(Estop())
                for _ in range(300):
                    sim._run_tick()
                sim.resume()
                for _ in range(50):
                    sim._run_tick()
    return read_recording(session, *load_named(str(file)).driven)


def test_a_stop_in_a_recording_spoils_no_lag(tmp_path: Path) -> None:
    """Pressures fell without a command: the lag was found as 33 ms, give or take two seconds."""
    for stopped in (False, True):
        session = recorded(tmp_path, stopped=stopped)
        for axis in range(3):
            found = fit_axis([session.axis_trace(axis)])
            assert found.lag_s.value == pytest.approx(0.05, abs=0.003)
            assert found.lag_s.half < 0.004


def test_a_tip_is_one_measurement_across_skipped_ticks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its age has the time of the robots, which does not advance with them: it was taken for a new one."""
    axis = Record(device=2e4, value=2e4, valid=True, time_s=math.nan)
    robot = {"flags": ENABLED, "axes": [axis] * 3}
    ticks = [
        Record(
            tick=k + (skipped := 30 if k > 201 else 0),
            skipped=skipped,
            deadline_s=0.01 * (k + skipped),
            robots=[
                Record(**robot, measured_tip_m=(1e-3 * (k // 4), 0.0, 0.0), measured_age_s=0.01 * (k % 4))
            ],
        )
        for k in range(400)
    ]
    session = Record(
        layout=Record(robots=[Record(name="arm")]),
        robot_file=lambda: load_named("stiffflop1"),
        rate_hz=100.0,
        ticks=lambda: ticks,
    )
    monkeypatch.setattr(recording, "Session", lambda path: session)
    found = read_recording(Path("skipped.mcap"), "arm")
    assert len(np.unique(found.tip_m, axis=0)) == len(found.tip_m) == 100
    assert np.all(np.diff(found.tip_at_s) > 0.0)


def test_devices_that_are_not_enabled_are_where_they_were_measured(tmp_path: Path) -> None:
    session = recorded(tmp_path, stopped=True)
    vented = np.flatnonzero((session.sent[:, 0] < 1e3) & (session.sent[:, 1] < 1e3))
    assert len(vented) > 200
    begin, end = session.period_s * vented[[40, -40]]
    for at_s in session.axis_at_s:
        assert not np.any((at_s > begin) & (at_s < end))
        assert np.any(at_s > end)
