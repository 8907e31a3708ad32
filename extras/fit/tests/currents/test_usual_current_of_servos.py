"""``contid calibrate currents`` after a run of emulated servos: their friction is known."""

from __future__ import annotations

from pathlib import Path

import pytest

from contid.control.engine.wiring import wired_buses
from contid.robot_file.load import load_robot_file
from contid_emulate.dynamixel.bench import Bench
from contid_emulate.dynamixel.motion import FRICTION_MA
from tests.sense.squeeze_runs import sense_of
from tests.support.command import contid_in
from tests.wire.dynamixel.current_hand import hand

pytestmark = [pytest.mark.process, pytest.mark.realtime]


def test_the_friction_of_emulated_servos(tmp_path: Path, configs: Path) -> None:
    hand(tmp_path, configs, "ignore")
    (bus,) = wired_buses(load_robot_file(tmp_path / "hand.yaml"))
    rows = contid_in(
        tmp_path, "path", "circle", "--center", "35,75", "--radius", "5", "--period", "3", "--laps", "2"
    ).stdout
    (tmp_path / "rows.csv").write_text(rows.replace("x_mm,y_mm", "left.x_mm,left.y_mm", 1))
    with Bench(bus.wiring.name, bus.wiring.options, bus.axes):  # type: ignore[arg-type]
        # On a busy machine a servo may answer too late when the bus opens (exit code 4).
        for attempt in range(5):
            session = f"free{attempt}.mcap"
            done = contid_in(tmp_path, "run", "hand.yaml", "--trajectory", "rows.csv", "--record", session)
            if done.returncode != 4:
                break
        assert done.returncode == 0, done.stdout + done.stderr
    found = contid_in(tmp_path, "calibrate", "currents", session, "--robot", "left", "--write", "hand.yaml")
    assert found.returncode == 0, found.stderr
    assert sense_of(tmp_path / "hand.yaml").usual_ma == pytest.approx(1.2 * FRICTION_MA, abs=5.0)
