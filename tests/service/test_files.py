"""The files of the service: checked by systemd and udev, and by `contid doctor`."""

from __future__ import annotations

import grp
import os
import re
import shutil
import stat
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from contid.client import Client
from contid.remote.protocol import socket_path
from contid_devices import host_checks, host_files
from tests.support.fingers import fingers
from tests.support.systemd import need_systemd_analyze, verify_unit
from tests.support.waiting import until

pytestmark = pytest.mark.process

ROOT = Path(__file__).parents[2]
UNIT = ROOT / "host" / host_files.UNIT
#: Of 10, by systemd's weights.
MAX_EXPOSURE = 1.5
RULES = ROOT / "host" / host_files.RULES


@pytest.fixture
def own_folder() -> Iterator[Path]:
    """Short enough for the path of a socket."""
    with tempfile.TemporaryDirectory(prefix="contid-") as folder:
        yield Path(folder)


def test_systemd_reads_the_unit(tmp_path: Path) -> None:
    verify_unit(UNIT, "hand", tmp_path)


def test_the_service_is_little_exposed(tmp_path: Path) -> None:
    need_systemd_analyze()
    copy = tmp_path / "contid@hand.service"
    shutil.copy(UNIT, copy)
    rated = subprocess.run(
        ["systemd-analyze", "security", "--offline=true", "--no-pager", str(copy)],
        capture_output=True,
        text=True,
    )
    found = re.search(r"exposure level for \S+: ([\d.]+)", rated.stdout)
    if found is None:
        pytest.skip(f"systemd-analyze cannot rate a file here: {rated.stderr.strip()}")
    assert float(found[1]) <= MAX_EXPOSURE, rated.stdout


def test_udev_reads_the_rules() -> None:
    if shutil.which("udevadm") is None:
        pytest.skip("udevadm is not installed")
    checked = subprocess.run(["udevadm", "verify", str(RULES)], capture_output=True, text=True)
    if "Unknown command verb" in checked.stderr:
        pytest.skip("this udevadm is older than 254 and has no verify")
    assert checked.returncode == 0, checked.stdout + checked.stderr


def test_the_shipped_files_satisfy_the_doctor(tmp_path: Path) -> None:
    for folder, file in ((host_files.UNIT_FOLDERS[0], UNIT), (host_files.RULES_FOLDERS[0], RULES)):
        where = tmp_path / folder.lstrip("/")
        where.mkdir(parents=True)
        shutil.copy(file, where)
    finding = host_checks.unit(tmp_path)
    assert not finding.ok
    assert "/usr/local/bin/contid, which does not exist" in finding.message
    program = tmp_path / "usr/local/bin/contid"
    program.parent.mkdir(parents=True)
    program.touch(0o755)
    for finding in (host_checks.unit(tmp_path), host_checks.rules(tmp_path)):
        assert finding.ok
        assert not finding.remedy


def test_the_doctor_reads_what_systemctl_edit_wrote(tmp_path: Path) -> None:
    """A drop-in in /etc belongs to a unit in another folder as well (systemd.unit(5))."""
    packaged = tmp_path / host_files.UNIT_FOLDERS[-1].lstrip("/")
    edited = tmp_path / host_files.UNIT_FOLDERS[0].lstrip("/") / f"{host_files.UNIT}.d"
    program = tmp_path / "opt/contid/bin/contid"
    for folder in (packaged, edited, program.parent):
        folder.mkdir(parents=True)
    shutil.copy(UNIT, packaged)
    program.touch(0o755)
    (edited / "override.conf").write_text(
        "[Service]\nExecStart=\nExecStart=/opt/contid/bin/contid run %i --disarmed\n"
    )
    assert host_checks.unit(tmp_path).ok
    assert [finding.message for finding in host_checks.clients(tmp_path)] == [
        "the service's own user and root"
    ]


@pytest.mark.parametrize("group", ["own", "none", "absent"])
def test_the_doctor_names_who_may_give_orders_to_the_service(group: str, tmp_path: Path) -> None:
    where = tmp_path / host_files.UNIT_FOLDERS[0].lstrip("/")
    where.mkdir(parents=True)
    names = {"own": grp.getgrgid(os.getegid()).gr_name, "none": "no-such-group", "absent": ""}
    option = f" --socket-group {names[group]}" if names[group] else ""
    (where / host_files.UNIT).write_text(UNIT.read_text().replace(" --socket-group contid", option))
    (finding,) = host_checks.clients(tmp_path)
    assert finding.ok == (group != "none")
    assert (names[group] or "the service's own user and root") in finding.message
    assert bool(finding.remedy) == (group == "none")
    assert host_checks.clients(tmp_path / "elsewhere") == []


@pytest.mark.realtime
def test_a_client_finds_the_service(
    tmp_path: Path, own_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The unit's own command line, with its folders and group replaced; a client without a path."""
    assert Path("/run/contid") == socket_path.SERVICES  # what %t/contid is for a system service
    (line,) = [each for each in UNIT.read_text().splitlines() if each.startswith("ExecStart=")]
    runtime = own_folder / "run"
    (runtime / "contid").mkdir(parents=True)
    (tmp_path / "finger.yaml").write_text(fingers(1))
    replaced = {"%t": str(runtime), "%i": "finger", "/etc/contid": str(tmp_path)}
    arguments = line.split()[1:]
    for old, new in replaced.items():
        arguments = [each.replace(old, new) for each in arguments]
    arguments[arguments.index("--socket-group") + 1] = grp.getgrgid(os.getegid()).gr_name
    monkeypatch.setattr(socket_path, "SERVICES", runtime / "contid")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(own_folder / "user"))
    with subprocess.Popen(
        [sys.executable, "-m", "contid", *arguments],
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    ) as daemon:  # fmt: skip
        try:
            until(lambda: bool(socket_path.running()) or daemon.poll() is not None, "it listens")
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
    for finding in (host_checks.unit(tmp_path), host_checks.rules(tmp_path)):
        assert "not installed" in finding.message
        assert finding.remedy


def test_a_unit_that_arms_by_itself_is_wrong(tmp_path: Path) -> None:
    where = tmp_path / host_files.UNIT_FOLDERS[0].lstrip("/")
    where.mkdir(parents=True)
    (where / host_files.UNIT).write_text(UNIT.read_text().replace(" --disarmed", ""))
    finding = host_checks.unit(tmp_path)
    assert not finding.ok
    assert "--disarmed" in finding.message


def test_asking_for_real_time_leaves_nothing_behind() -> None:
    before = os.sched_getscheduler(0)
    assert host_checks.real_time().subject == "real time"
    assert os.sched_getscheduler(0) == before
    assert host_checks.shared_memory().message


@pytest.mark.parametrize(
    ("rule", "masked", "taken"),
    [
        ('ENV{PRODUCT}=="1a86/7523/*", GOTO="run"', False, True),
        ('ENV{PRODUCT}=="1A86/7523/*", GOTO="run"', True, False),
        ('# ENV{PRODUCT}=="10c4/ea60/*", GOTO="run"', False, False),
    ],
)
def test_programs_that_take_serial_adapters_are_named(
    tmp_path: Path, rule: str, masked: bool, taken: bool
) -> None:
    assert host_checks.port_takers(tmp_path) == []
    rules = tmp_path / "usr/lib/udev/rules.d/85-brltty.rules"
    rules.parent.mkdir(parents=True)
    rules.write_text(rule + "\n")
    if masked:
        hidden = tmp_path / "etc/udev/rules.d/85-brltty.rules"
        hidden.parent.mkdir(parents=True)
        hidden.symlink_to("/dev/null")
    manager = tmp_path / "usr/sbin/ModemManager"
    manager.parent.mkdir(parents=True)
    manager.touch()
    found = {finding.subject: finding for finding in host_checks.port_takers(tmp_path)}
    assert ("brltty" in found) == taken
    assert found["ModemManager"].warning
    shutil.copy(RULES, rules.parent)
    assert not host_checks.port_takers(tmp_path)[-1].warning


def test_the_rules_name_the_usual_adapters() -> None:
    text = RULES.read_text()
    for vendor, product in (("10c4", "ea60"), ("1a86", "7523"), ("1a86", "55d4"), ("fff1", "ff48")):
        assert f'ATTRS{{idVendor}}=="{vendor}", ATTRS{{idProduct}}=="{product}"' in text
    assert 'ATTRS{idVendor}=="2f5d"' in text
