"""The commands that talk to devices, against ``contid emulate`` in a process of its own."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.support.command import contid_in, emulating

pytestmark = pytest.mark.process

HOMING = "homing: {method: hard_stop, direction: -1, current_ma: 120, speed_deg_s: 360, at_mm: -1.0}"


@pytest.fixture
def folder(tmp_path: Path, configs: Path) -> Path:
    """A folder with the emulated hand, one axis of which homes against a stop."""
    text = (configs / "hand.emulated.yaml").read_text()
    wired = "left: {bus: servos, id: 1, mm_per_rev: 37.69911184307752}"
    assert wired in text
    text = text.replace(wired, wired[:-1] + f", {HOMING}}}")
    text = text.replace(
        "    baud: 1000000\n", "    baud: 1000000\n    usb_latency_ms: 40\n    watchdog_ms: 2000\n"
    )
    (tmp_path / "hand.yaml").write_text(text)
    return tmp_path


@pytest.mark.realtime
def test_emulate_doctor_scan_servo_and_home(folder: Path) -> None:
    before = (folder / "hand.yaml").read_text()
    with emulating(folder, "hand.yaml", "--faults", "faults.jsonl"):
        assert (folder / "hand.tty").is_symlink()
        report = contid_in(folder, "doctor", "hand.yaml", "--json")
        findings = [json.loads(line) for line in report.stdout.splitlines()]
        assert report.returncode == 0, report.stdout
        assert {f["subject"] for f in findings if f["warning"] and f["subject"].startswith("id")} == {
            f"id {i} settings" for i in (1, 2, 3, 4)
        }
        found = contid_in(folder, "scan", "hand.tty", "--baud", "1000000", "--json")
        assert [json.loads(line)["address"] for line in found.stdout.splitlines()] == [1, 2, 3, 4]
        # A port that answered one driver is not asked by the others.
        assert "no hello" not in found.stderr
        assert "id 2 restarted" in contid_in(folder, "servo", "--port", "hand.tty", "reboot", "2").stdout
        dry = contid_in(folder, "home", "hand.yaml", "--dry-run")
        assert dry.returncode == 0, dry.stderr
        assert (folder / "hand.yaml").read_text() == before
        homed = contid_in(folder, "home", "hand.yaml", "left.left")
        assert homed.returncode == 0, homed.stderr
        # The emulated stop is 10 degrees below the travel, which starts at 0 mm; the file has -1 mm.
        zero_deg = float(homed.stdout.split("zero_deg ")[1].split()[0])
        assert zero_deg == pytest.approx(-10.0 + 360.0 / 37.69911184307752, abs=0.3)
        text = (folder / "hand.yaml").read_text()
        assert f"zero_deg: {zero_deg:g}" in text
        assert "hard stop with 120 mA" in text
        assert contid_in(folder, "home", "hand.yaml", "right.left").returncode == 4
        assert contid_in(folder, "home", "hand.yaml", "left.missing").returncode == 2
    assert not (folder / "hand.tty").exists()


def test_commands_name_what_is_missing(folder: Path) -> None:
    report = contid_in(folder, "doctor", "hand.yaml")
    assert report.returncode == 4
    assert "no port hand.tty" in report.stdout
    assert "contid scan" in report.stdout
    assert "no bus with axes has driver 'due'" in contid_in(folder, "emulate", "due", "hand.yaml").stderr
    assert contid_in(folder, "scan", "hand.tty").returncode == 2
    shipped = contid_in(folder, "home", "trirack2")
    assert (shipped.returncode, "contid new NAME --from trirack2" in shipped.stderr) == (2, True), (
        shipped.stderr
    )
    assert "did you mean 'hand'" in contid_in(folder, "home", "hnad").stderr


@pytest.mark.parametrize(("driver", "robot"), [("dynamixel", "finger"), ("due", "trirack")])
def test_an_emulator_reports_where_it_cannot_put_its_port(
    tmp_path: Path, configs: Path, driver: str, robot: str
) -> None:
    (tmp_path / "file").touch()
    text = (configs / f"{robot}.emulated.yaml").read_text()
    (tmp_path / "mine.yaml").write_text(text.replace(f"./{robot}.tty", "file/port.tty"))
    done = contid_in(tmp_path, "emulate", driver, "mine.yaml")
    assert done.returncode == 4
    assert "port.tty" in done.stderr
    assert "run it where you may write" in done.stderr
