"""The files of the service, as the real tools read them, and what `contid doctor` says about them."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from contid.control import machine

ROOT = Path(__file__).parents[2]
UNIT = ROOT / "service" / machine.UNIT
RULES = ROOT / "udev" / machine.RULES


def test_systemd_reads_the_unit(tmp_path: Path) -> None:
    if shutil.which("systemd-analyze") is None:
        pytest.skip("systemd-analyze is not installed")
    copy = tmp_path / "contid@hand.service"
    # The command itself is not installed where tests run.
    copy.write_text(UNIT.read_text().replace("/usr/local/bin/contid", "/bin/true"))
    told = subprocess.run(["systemd-analyze", "verify", str(copy)], capture_output=True, text=True)
    if "Failed to initialize manager" in told.stderr:
        pytest.skip(f"systemd-analyze cannot work here: {told.stderr.strip()}")
    assert told.returncode == 0, told.stderr
    assert "contid@hand" not in told.stderr


def test_udev_reads_the_rules() -> None:
    if shutil.which("udevadm") is None:
        pytest.skip("udevadm is not installed")
    told = subprocess.run(["udevadm", "verify", str(RULES)], capture_output=True, text=True)
    if "Unknown command verb" in told.stderr:
        pytest.skip("this udevadm is older than 254 and has no verify")
    assert told.returncode == 0, told.stdout + told.stderr


def test_the_shipped_files_satisfy_the_doctor(tmp_path: Path) -> None:
    for folder, file in ((machine.UNIT_FOLDERS[0], UNIT), (machine.RULES_FOLDERS[0], RULES)):
        place = tmp_path / folder.lstrip("/")
        place.mkdir(parents=True)
        shutil.copy(file, place)
    for finding in (machine.unit(tmp_path), machine.rules(tmp_path)):
        assert finding.ok
        assert not finding.remedy


def test_what_is_missing_comes_with_its_remedy(tmp_path: Path) -> None:
    for finding in (machine.unit(tmp_path), machine.rules(tmp_path)):
        assert "not installed" in finding.message
        assert finding.remedy


def test_a_unit_that_arms_by_itself_is_wrong(tmp_path: Path) -> None:
    place = tmp_path / machine.UNIT_FOLDERS[0].lstrip("/")
    place.mkdir(parents=True)
    (place / machine.UNIT).write_text(UNIT.read_text().replace(" --disarmed", ""))
    finding = machine.unit(tmp_path)
    assert not finding.ok
    assert "--disarmed" in finding.message


def test_asking_for_real_time_leaves_nothing_behind() -> None:
    import os

    before = os.sched_getscheduler(0)
    assert machine.real_time().subject == "real time"
    assert os.sched_getscheduler(0) == before
    assert machine.shared_memory().message
