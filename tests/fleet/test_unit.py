"""The unit of the bridge: systemd reads it, it sees no device, and it reaches the sockets of daemons."""

from __future__ import annotations

import configparser
from pathlib import Path

from tests.support.systemd import verify_unit

SERVICE = Path(__file__).parents[2] / "service"
UNIT = SERVICE / "contid-fleet@.service"


def section(path: Path) -> configparser.SectionProxy:
    parser = configparser.ConfigParser(strict=False, interpolation=None)
    # The documented way to keep the case of keys; typeshed has it as a method.
    parser.optionxform = str  # type: ignore[assignment, method-assign]
    parser.read(path)
    return parser["Service"]


def test_systemd_reads_it(tmp_path: Path) -> None:
    verify_unit(UNIT, "lab", tmp_path)


def test_network_and_devices_are_apart() -> None:
    bridge, daemon = section(UNIT), section(SERVICE / "contid@.service")
    assert bridge["PrivateDevices"] == "yes"
    assert "AF_INET" in bridge["RestrictAddressFamilies"]
    assert daemon["RestrictAddressFamilies"] == "AF_UNIX"
    assert bridge["User"] != daemon["User"]
    assert bridge["SupplementaryGroups"] == daemon["Group"]
    assert f"--socket-group {daemon['Group']}" in daemon["ExecStart"]
