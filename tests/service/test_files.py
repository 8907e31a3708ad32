"""The files of the service, as the real tools read them, and what `contid doctor` says about them."""

from __future__ import annotations

import grp
import os
import shutil
import stat
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from contid.client import Client
from contid.control.process import host_checks as machine
from contid.remote.protocol import socket_path as place
from tests.control.fingers import fingers
from tests.remote.daemons import until

ROOT = Path(__file__).parents[2]
UNIT = ROOT / "service" / machine.UNIT
RULES = ROOT / "udev" / machine.RULES


@pytest.fixture
def own_folder() -> Iterator[Path]:
    """Short enough for the path of a socket."""
    with tempfile.TemporaryDirectory(prefix="contid-") as folder:
        yield Path(folder)


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
        where = tmp_path / folder.lstrip("/")
        where.mkdir(parents=True)
        shutil.copy(file, where)
    finding = machine.unit(tmp_path)
    assert not finding.ok
    assert "/usr/local/bin/contid, which is not there" in finding.message
    program = tmp_path / "usr/local/bin/contid"
    program.parent.mkdir(parents=True)
    program.touch(0o755)
    for finding in (machine.unit(tmp_path), machine.rules(tmp_path)):
        assert finding.ok
        assert not finding.remedy


@pytest.mark.parametrize("group", ["own", "none", "absent"])
def test_the_doctor_says_who_may_give_orders_to_the_service(group: str, tmp_path: Path) -> None:
    where = tmp_path / machine.UNIT_FOLDERS[0].lstrip("/")
    where.mkdir(parents=True)
    names = {"own": grp.getgrgid(os.getegid()).gr_name, "none": "no-such-group", "absent": ""}
    option = f" --socket-group {names[group]}" if names[group] else ""
    (where / machine.UNIT).write_text(UNIT.read_text().replace(" --socket-group contid", option))
    (finding,) = machine.clients(tmp_path)
    assert finding.ok == (group != "none")
    assert (names[group] or "its own user and root") in finding.message
    assert bool(finding.remedy) == (group == "none")
    assert machine.clients(tmp_path / "elsewhere") == []


@pytest.mark.realtime
def test_the_service_is_found_by_who_may_give_it_orders(
    tmp_path: Path, own_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The unit's own command line, with its folders and group replaced; a client that is told no path."""
    assert Path("/run/contid") == place.SERVICES  # what %t/contid is for a system service
    (line,) = [each for each in UNIT.read_text().splitlines() if each.startswith("ExecStart=")]
    runtime = own_folder / "run"
    (runtime / "contid").mkdir(parents=True)
    (tmp_path / "finger.yaml").write_text(fingers(1))
    replaced = {"%t": str(runtime), "%i": "finger", "/etc/contid": str(tmp_path)}
    message = line.split()[1:]
    for old, new in replaced.items():
        message = [each.replace(old, new) for each in message]
    message[message.index("--socket-group") + 1] = grp.getgrgid(os.getegid()).gr_name
    monkeypatch.setattr(place, "SERVICES", runtime / "contid")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(own_folder / "user"))
    with subprocess.Popen(
        [sys.executable, "-m", "contid", *message],
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    ) as daemon:  # fmt: skip
        try:
            until(lambda: bool(place.running()) or daemon.poll() is not None, "it listens")
            with Client() as client:
                until(lambda: client.status()["robots"]["f0"]["state"] == "READY", "it connects")
                assert client.path.parent == runtime / "contid"
                mode = client.path.stat()
                assert stat.S_IMODE(mode.st_mode) == 0o660
                assert mode.st_gid == os.getegid()
        finally:
            daemon.terminate()
            daemon.communicate(timeout=30)
    assert daemon.returncode == 130


def test_what_is_missing_comes_with_its_remedy(tmp_path: Path) -> None:
    for finding in (machine.unit(tmp_path), machine.rules(tmp_path)):
        assert "not installed" in finding.message
        assert finding.remedy


def test_a_unit_that_arms_by_itself_is_wrong(tmp_path: Path) -> None:
    where = tmp_path / machine.UNIT_FOLDERS[0].lstrip("/")
    where.mkdir(parents=True)
    (where / machine.UNIT).write_text(UNIT.read_text().replace(" --disarmed", ""))
    finding = machine.unit(tmp_path)
    assert not finding.ok
    assert "--disarmed" in finding.message


def test_asking_for_real_time_leaves_nothing_behind() -> None:
    import os

    before = os.sched_getscheduler(0)
    assert machine.real_time().subject == "real time"
    assert os.sched_getscheduler(0) == before
    assert machine.shared_memory().message
