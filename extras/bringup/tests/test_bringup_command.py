"""``contid bringup`` on the linked firmware behind a pty: what it names, writes, and returns."""

from __future__ import annotations

import io
import re
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import click
import pytest
from click.testing import CliRunner

from contid.cli.commands.check import command as check
from contid.control.daemon.run_request import RunRequest, load
from contid.control.engine.cycle import RealClock
from contid.control.engine.wiring import wired_buses
from contid.errors import DeviceError
from contid.robot_file.load import load_robot_file, parse_robot_file
from contid_bringup import motor
from contid_bringup.command import Person, command
from contid_bringup.motor import MotorResult, bring_up_motor
from contid_devices.doctor import command as doctor
from contid_devices.pulsed_motors import PulsedBus
from contid_drivers.due.bus import DueBus
from contid_drivers.due.options import DueBusOptions
from contid_emulate.due import DueEmulator

pytestmark = [pytest.mark.process, pytest.mark.realtime]

CONFIG = Path(__file__).parents[3] / "configs" / "trirack.emulated.yaml"
FIRST, SECOND = "arm.s1.l1", "arm.s1.l2"


@pytest.fixture
def robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[Path, DueEmulator]]:
    """The shipped robot of three motors, and its board."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    path = tmp_path / "robot.yaml"
    text = CONFIG.read_text().replace("./trirack.tty", str(tmp_path / "board"))
    path.write_text(text.replace("role: motor", "role: motor\n    latency_ms: 60"))
    (bus,) = wired_buses(load_robot_file(path))
    assert isinstance(bus.wiring.options, DueBusOptions)
    with DueEmulator(bus.wiring.options, bus.axes) as board:
        yield path, board


def test_a_healthy_motor_is_proven_and_a_change_of_it_is_named_afterwards(
    robot: tuple[Path, DueEmulator],
) -> None:
    path, _ = robot
    before = path.read_text()
    done = CliRunner().invoke(command, [str(path), FIRST, "--yes"])
    assert done.exit_code == 0, done.output
    assert f"{FIRST}: ok: motor and encoder are connected" in done.output
    loaded = load_robot_file(path)
    found = loaded.file.bringup[FIRST]
    # The emulated motor has the numbers of the robot file: 5 %, 575 deg/s, 40 ms.
    assert found.friction_percent == pytest.approx(5.0, rel=0.05)
    assert found.no_load_deg_s is None or found.no_load_deg_s == pytest.approx(575.0, rel=0.1)
    assert found.time_constant_ms is None or found.time_constant_ms == pytest.approx(40.0, rel=0.1)
    assert found.firmware == "1.7.2"
    assert path.read_text().startswith(before.rstrip("\n"))
    page = path.with_name("robot-bringup.html").read_text()
    assert FIRST in page
    assert found.wiring in page
    _names_changes(path)


def _names_changes(path: Path) -> None:
    """A change of wiring or firmware after the bring-up of the first motor is named where it is read."""
    assert f"bringup {FIRST}" not in CliRunner().invoke(check, [str(path)]).output
    text = path.read_text()
    path.write_text(text.replace("channel: m0,", "channel: m0, counts_per_rev: 4800,"))
    changed = CliRunner().invoke(check, [str(path)]).output
    assert f"bringup {FIRST}: its wiring in this file was changed since its bring-up" in changed
    path.write_text(text.replace("firmware: 1.7.2", "firmware: 1.5.0"))
    examined = CliRunner().invoke(doctor, [str(path)]).output
    other = f"warn .*bringup {FIRST}: its firmware is 1.7.2; at its bring-up, .*, it was 1.5.0"
    assert re.search(other, examined)
    assert re.search(f"warn .*bringup {SECOND}: never brought up", examined)
    # A run finds it, too, before it begins; what it found is in the text that recordings keep.
    full = load_robot_file(path)
    slow = load(RunRequest(str(path)))
    full_mm_s = full.driven["arm"].rates.velocity_mm_s
    assert full_mm_s is not None
    assert slow.driven["arm"].rates.velocity_mm_s == 0.2 * full_mm_s
    again = parse_robot_file(slow.text, "recorded", recorded=True)
    assert again.driven["arm"].rates == slow.driven["arm"].rates
    path.write_text(text)
    assert load(RunRequest(str(path))).driven["arm"].rates == full.driven["arm"].rates


def test_swapped_cables_are_named_and_the_code_is_4(robot: tuple[Path, DueEmulator]) -> None:
    path, board = robot
    for line in ("set 0 encoder_of 1", "set 1 encoder_of 0", "set 2 encoder_reversed 1"):
        board.command(line)
    start = float(board.command("get 0").split()[1])
    done = CliRunner().invoke(command, [str(path), "--yes"])
    assert done.exit_code == 4, done.output
    assert f"{FIRST}: crossed-axes: driving it moves the encoder of {SECOND}" in done.output
    assert f"{SECOND}: crossed-axes: driving it moves the encoder of {FIRST}" in done.output
    assert "arm.s1.l3: reversed: positive duty counts down" in done.output
    moved_deg = abs(float(board.command("get 0").split()[1]) - start) / 4776 * 360
    assert moved_deg < 2.0
    verdicts = {each.verdict for each in load_robot_file(path).file.bringup.values()}
    assert verdicts == {"crossed-axes", "reversed"}
    checked = CliRunner().invoke(check, [str(path)])
    assert checked.exit_code == 0
    assert f"bringup {FIRST}: crossed-axes at its last bring-up" in checked.output


def test_it_asks_before_it_moves_and_names_unknown_axes(robot: tuple[Path, DueEmulator]) -> None:
    path, board = robot
    refused = CliRunner().invoke(command, [str(path)])
    assert refused.exit_code == 2
    assert "--yes" in refused.output
    assert float(board.command("get 0").split()[1]) == 0.0
    unknown = CliRunner().invoke(command, [str(path), "arm.none", "--yes"])
    assert "no axis 'arm.none'" in str(unknown.exception)


@pytest.fixture(scope="module")
def found() -> dict[str, MotorResult]:
    """By axis, what was found of it; a motor takes 8 s."""
    return {}


@pytest.mark.parametrize("end", [DeviceError("board", "no answer"), KeyboardInterrupt()])
def test_an_end_at_a_later_axis_keeps_what_was_found(
    robot: tuple[Path, DueEmulator],
    monkeypatch: pytest.MonkeyPatch,
    found: dict[str, MotorResult],
    end: BaseException,
) -> None:
    path, _ = robot

    def ends_at_the_second(bus: PulsedBus, axis: str, *rest: Any) -> MotorResult:
        if axis == SECOND:
            raise end
        if axis not in found:
            found[axis] = bring_up_motor(bus, axis, *rest)
        return found[axis]

    monkeypatch.setattr(motor, "bring_up_motor", ends_at_the_second)
    done = CliRunner().invoke(command, [str(path), "--yes"])
    assert done.exit_code != 0
    assert {axis: each.verdict for axis, each in load_robot_file(path).file.bringup.items()} == {FIRST: "ok"}
    page = path.with_name("robot-bringup.html").read_text()
    assert (FIRST in page, SECOND in page) == (True, False)


def _armed(path: Path) -> DueBus:
    """The bus of the robot, with its first two axes under power."""
    (bus,) = wired_buses(load_robot_file(path))
    assert isinstance(bus.wiring.options, DueBusOptions)
    opened = DueBus(bus.wiring.name, bus.wiring.options, bus.axes, RealClock())
    opened.open()
    opened.enable([FIRST, SECOND])
    return opened


def test_a_latched_fault_whose_cause_persists_is_named_and_hides_no_other_axis(
    robot: tuple[Path, DueEmulator],
) -> None:
    path, board = robot
    with closing(_armed(path)) as bus:
        board.command("set 0 bridge 1")
        until = time.monotonic() + 5.0
        while not bus.exchange({})[FIRST].fault and time.monotonic() < until:
            time.sleep(0.02)
    # The second axis is latched too, by the watchdog.
    done = CliRunner().invoke(command, [str(path), FIRST, SECOND, "--yes", "--dry-run"])
    assert done.exit_code == 4, done.output
    assert f"{FIRST}: fault-line" in done.output
    assert f"{SECOND}: ok" in done.output


def test_a_dry_run_relaxes_a_motor_that_its_watchdog_left_holding_and_writes_nothing(
    robot: tuple[Path, DueEmulator],
) -> None:
    path, _ = robot
    path.write_text(
        path.read_text().replace("channel: m0,", "channel: m0, on_watchdog: hold, start_state: brake,")
    )
    before = path.read_text()
    _armed(path).close()
    time.sleep(0.5)  # longer than the watchdog
    done = CliRunner().invoke(command, [str(path), SECOND, "--yes", "--dry-run"])
    assert done.exit_code == 0, done.output
    # A dry run writes nothing.
    assert path.read_text() == before
    assert not path.with_name("robot-bringup.html").exists()


def test_a_file_of_simulated_buses_is_refused_before_anything_is_asked(tmp_path: Path) -> None:
    path = tmp_path / "finger.yaml"
    text = (CONFIG.parent / "finger.yaml").read_text().replace("driver: dynamixel", "driver: sim")
    text = re.sub(r"\n    (port|baud): .*", "", text)
    path.write_text(re.sub(r"\bid: \d+", "device: servo", text))
    refused = CliRunner().invoke(command, [str(path)])
    assert "no driver of this file can be brought up" in str(refused.exception)
    assert "cannot be brought up" in refused.output


def test_an_axis_that_was_named_and_not_examined_is_not_proven(robot: tuple[Path, DueEmulator]) -> None:
    path, _ = robot
    text = path.read_text().replace("\nrobots:", "  simulated:\n    driver: sim\n\nrobots:", 1)
    path.write_text(
        re.sub(r"l3: {bus: motors, channel: m2, (.*?), .*}", r"l3: {bus: simulated, device: motor, \1}", text)
    )
    done = CliRunner().invoke(command, [str(path), FIRST, "arm.s1.l3", "--yes", "--dry-run"])
    assert f"{FIRST}: ok" in done.output, (done.output, done.exception)
    assert "arm.s1.l3 not examined" in done.output
    assert "not proven: arm.s1.l3" in done.output
    assert done.exit_code == 4


@pytest.mark.parametrize(("typed", "bar"), [("nan\n0,5\n", 0.5), ("inf\nx\n\n", None)])
def test_a_gauge_shows_a_finite_number(
    typed: str, bar: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO(typed))
    assert Person().gauge_bar(FIRST, lambda: time.sleep(0.001)) == bar


def test_the_end_of_stdin_is_no_opened_dump_valve(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO(""))
    with pytest.raises(click.Abort):
        Person().dumped(FIRST, lambda: time.sleep(0.001))
