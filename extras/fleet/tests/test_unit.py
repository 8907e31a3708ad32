"""The unit of the bridge: systemd reads it, it sees no device, and it reaches the sockets of daemons."""

from __future__ import annotations

import configparser
from pathlib import Path

import pytest

from tests.support.systemd import verify_unit

SERVICE = Path(__file__).parents[3] / "host"
UNIT = SERVICE / "contid-fleet@.service"
ROUTER = SERVICE / "contid-fleet-router@.service"


def section(path: Path) -> configparser.SectionProxy:
    parser = configparser.ConfigParser(strict=False, interpolation=None)
    # The documented way to keep the case of keys; typeshed has it as a method.
    parser.optionxform = str  # type: ignore[assignment, method-assign]
    parser.read(path)
    return parser["Service"]


@pytest.mark.process
@pytest.mark.parametrize("unit", [UNIT, ROUTER], ids=["bridge", "router"])
def test_systemd_reads_it(unit: Path, tmp_path: Path) -> None:
    verify_unit(unit, "lab", tmp_path)


def test_a_router_reaches_no_daemon() -> None:
    router, bridge = section(ROUTER), section(UNIT)
    assert router["ExecStart"].split()[1:3] == ["fleet", "route"]
    assert "SupplementaryGroups" not in router
    assert router["RuntimeDirectory"] != bridge["RuntimeDirectory"]
    own = {"execstart", "supplementarygroups", "runtimedirectory", "workingdirectory", "nice"}
    confined = {key: value for key, value in bridge.items() if key.lower() not in own}
    assert {key: router[key] for key in confined} == confined


def test_network_and_devices_are_apart() -> None:
    bridge, daemon = section(UNIT), section(SERVICE / "contid@.service")
    assert bridge["PrivateDevices"] == "yes"
    assert "AF_INET" in bridge["RestrictAddressFamilies"]
    assert daemon["RestrictAddressFamilies"] == "AF_UNIX"
    assert bridge["User"] != daemon["User"]
    assert bridge["SupplementaryGroups"] == daemon["Group"]
    assert f"--socket-group {daemon['Group']}" in daemon["ExecStart"]
