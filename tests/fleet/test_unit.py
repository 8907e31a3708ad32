"""The unit of the bridge: systemd reads it, it sees no device, and it reaches the sockets of daemons."""

from __future__ import annotations

import configparser
import shutil
import subprocess
from pathlib import Path

import pytest

SERVICE = Path(__file__).parents[2] / "service"
UNIT = SERVICE / "contid-fleet@.service"


def section(path: Path) -> configparser.SectionProxy:
    parser = configparser.ConfigParser(strict=False, interpolation=None)
    parser.optionxform = str  # type: ignore[assignment, method-assign]
    parser.read(path)
    return parser["Service"]


def test_systemd_reads_it(tmp_path: Path) -> None:
    if shutil.which("systemd-analyze") is None:
        pytest.skip("systemd-analyze is not installed")
    copy = tmp_path / "contid-fleet@lab.service"
    copy.write_text(UNIT.read_text().replace("/usr/local/bin/contid", "/bin/true"))
    checked = subprocess.run(["systemd-analyze", "verify", str(copy)], capture_output=True, text=True)
    if "Failed to initialize manager" in checked.stderr:
        pytest.skip(f"systemd-analyze cannot work here: {checked.stderr.strip()}")
    assert checked.returncode == 0, checked.stderr
    assert "contid-fleet@lab" not in checked.stderr


def test_network_and_devices_are_apart() -> None:
    bridge, daemon = section(UNIT), section(SERVICE / "contid@.service")
    assert bridge["PrivateDevices"] == "yes"
    assert "AF_INET" in bridge["RestrictAddressFamilies"]
    assert daemon["RestrictAddressFamilies"] == "AF_UNIX"
    assert bridge["User"] != daemon["User"]
    assert bridge["SupplementaryGroups"] == daemon["Group"]
    assert f"--socket-group {daemon['Group']}" in daemon["ExecStart"]
