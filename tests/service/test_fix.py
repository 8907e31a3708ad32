"""`contid doctor --fix`: what it writes, that it asks, and what it does without rights."""

from __future__ import annotations

import os
import pty
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from contid.errors import ContidError
from contid_devices import host_checks
from contid_devices.host_files import HostFile, missing_files
from tests.support.command import contid_in, environment

pytestmark = pytest.mark.process

UNPRIVILEGED = 65534


def test_every_file_is_installed_once_and_satisfies_the_doctor(tmp_path: Path) -> None:
    files = missing_files(tmp_path, service=True)
    assert [str(file.path.relative_to(tmp_path)) for file in files] == [
        "etc/udev/rules.d/99-contid.rules",
        "etc/security/limits.d/contid.conf",
        "etc/systemd/system/contid@.service",
    ]
    for file in files:
        HostFile(file.purpose, file.path, file.text).install()
        assert file.path.stat().st_mode & 0o777 == 0o644
    assert missing_files(tmp_path, service=True) == []
    assert host_checks.rules(tmp_path).ok
    assert not host_checks.rules(tmp_path).remedy
    # What only the machine can give is left: the command that the unit starts.
    assert "/usr/local/bin/contid, which does not exist" in host_checks.unit(tmp_path).message


def test_another_version_is_replaced_and_kept(tmp_path: Path) -> None:
    rules = tmp_path / "usr/lib/udev/rules.d/99-contid.rules"
    rules.parent.mkdir(parents=True)
    rules.write_text("old")
    assert "is not that of this version" in host_checks.rules(tmp_path).message
    (file,) = [file for file in missing_files(tmp_path) if file.path == rules]
    HostFile(file.purpose, file.path, file.text).install()
    assert rules.with_name("99-contid.rules.before").read_text() == "old"
    assert sorted(path.name for path in rules.parent.iterdir()) == [rules.name, f"{rules.name}.before"]
    assert host_checks.rules(tmp_path).ok


def test_a_command_that_fails_ends_with_its_output(tmp_path: Path) -> None:
    path = tmp_path / "a"
    with pytest.raises(
        ContidError, match=r"is written and not yet in force: sh -c echo why >&2; exit 3: why"
    ):
        HostFile("nothing", path, "x", (("sh", "-c", "echo why >&2; exit 3"),)).install()
    with pytest.raises(ContidError, match=r"no-such-command: No such file"):
        HostFile("nothing", path, "x", (("no-such-command",),)).install()


def test_without_rights_the_command_with_rights_is_printed(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "contid", "doctor", "finger", "--fix", "--yes"]
    if os.geteuid() == 0:
        if shutil.which("setpriv") is None:
            pytest.skip("setpriv is not installed")
        command = [
            "setpriv",
            f"--reuid={UNPRIVILEGED}",
            f"--regid={UNPRIVILEGED}",
            "--clear-groups",
            *command,
        ]
    done = subprocess.run(
        command, cwd="/", env=environment(), capture_output=True, text=True, timeout=60, check=False
    )
    if "Permission denied" in done.stderr and "no right to write" not in done.stderr:
        pytest.skip("another user cannot read this interpreter")
    assert done.returncode == 2
    assert "no right to write /etc/udev/rules.d/99-contid.rules" in done.stderr
    assert "sudo " in done.stderr
    assert done.stderr.rstrip().endswith("doctor finger --fix --yes")


@pytest.mark.skipif(os.geteuid() != 0, reason="the question comes after the check of rights")
def test_no_terminal_no_question_and_nothing_written(tmp_path: Path) -> None:
    if not missing_files():
        pytest.skip("all files are installed here")
    done = contid_in(tmp_path, "doctor", "finger", "--fix")
    assert done.returncode == 2
    assert "stdin is no terminal; --yes installs all" in done.stderr
    before = [file.path for file in missing_files()]
    leader, follower = pty.openpty()
    with subprocess.Popen(
        [sys.executable, "-m", "contid", "doctor", "finger", "--fix"],
        stdin=follower, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment(),
    ) as asked:  # fmt: skip
        os.write(leader, b"n\n" * len(before))
        _, errors = asked.communicate(timeout=60)
    os.close(leader)
    os.close(follower)
    assert errors.count("Write /") == len(before)
    assert [file.path for file in missing_files()] == before


def test_options_that_need_fix(tmp_path: Path) -> None:
    done = contid_in(tmp_path, "doctor", "finger", "--yes")
    assert done.returncode == 2
    assert "--service and --yes go with --fix" in done.stderr


def test_a_file_that_cannot_be_installed_leaves_nothing_behind(tmp_path: Path) -> None:
    path = tmp_path / "99-contid.rules"
    path.mkdir()
    with pytest.raises(ContidError, match="cannot write it"):
        HostFile("access", path, "SUBSYSTEM").install()
    assert list(tmp_path.iterdir()) == [path]
