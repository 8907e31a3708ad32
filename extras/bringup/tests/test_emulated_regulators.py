"""``contid bringup`` of regulators on the linked firmware behind a pty."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from contid.control.engine.wiring import wired_buses
from contid.robot_file.load import load_robot_file
from contid_bringup.command import command
from contid_drivers.due.options import DueBusOptions
from contid_emulate.due import DueEmulator

CONFIG = Path(__file__).parents[3] / "configs" / "stiffflop1.emulated.yaml"


@pytest.mark.process
@pytest.mark.realtime
def test_half_of_the_range_is_named_and_the_one_beside_it_is_proven(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    path = tmp_path / "robot.yaml"
    text = CONFIG.read_text().replace("./stiffflop1-regulators.tty", str(tmp_path / "board"))
    path.write_text(
        text.replace("role: pressure", "role: pressure\n    latency_ms: 60\n    watchdog_ms: 1000")
    )
    (bus,) = wired_buses(load_robot_file(path))
    assert isinstance(bus.wiring.options, DueBusOptions)
    with DueEmulator(bus.wiring.options, bus.axes) as board:
        board.command("set 0 full_pa 150000")
        done = CliRunner().invoke(command, [str(path), "arm.s1.p1", "arm.s1.p2", "--yes"])
        assert done.exit_code == 4, done.output
        assert "arm.s1.p1: half-scale: its reading is half of the command" in done.output
        assert "arm.s1.p2: ok: its pressure follows the command, and vents" in done.output
        assert "arm.s1.p2: vents to a tenth in " in done.output
        assert float(board.command("get 1").split()[2]) < 2000.0
    assert load_robot_file(path).file.bringup["arm.s1.p2"].verdict == "ok"
