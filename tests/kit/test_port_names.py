"""Names of serial ports that other adapters can have as well."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from contid.kit import serial_ports
from contid_driverkit.port_checks import port_name


@dataclass
class Port:
    device: str
    vid: int | None = 0x1A86
    pid: int | None = 0x7523
    serial_number: str | None = None


@pytest.fixture
def links(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(serial_ports, "SERIAL", tmp_path / "serial")
    for number in range(2):
        tty = tmp_path / f"ttyUSB{number}"
        tty.touch()
        for folder, name in (("by-id", "usb-1a86_USB_Serial-if00-port0"), ("by-path", f"usb-0:{number}")):
            link = tmp_path / "serial" / folder / name
            link.parent.mkdir(parents=True, exist_ok=True)
            if not link.is_symlink():
                link.symlink_to(tty)
    return tmp_path


def checked(links: Path, monkeypatch: pytest.MonkeyPatch, pattern: str, *ports: Port) -> tuple[str, str]:
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: list(ports))
    path = links / pattern
    (found,) = port_name("servos", str(path), str(path))
    assert found.ok
    assert found.warning == bool(found.remedy)
    return found.message, found.remedy


def test_a_name_that_two_equal_adapters_have_is_named(links: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    two = [Port(str(links / f"ttyUSB{number}")) for number in range(2)]
    by_id = "serial/by-id/usb-1a86_USB_Serial-if00-port0"
    message, remedy = checked(links, monkeypatch, by_id, *two)
    assert "is not unique" in message
    assert remedy.startswith(f"write port: {links}/serial/by-path/usb-0:0")
    assert "no serial number" in checked(links, monkeypatch, by_id, two[0])[0]
    assert checked(links, monkeypatch, "serial/by-path/usb-0:1", *two)[1] == ""


def test_a_name_of_the_kernel_depends_on_the_order(links: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    known = Port(str(links / "ttyUSB0"), 0x0403, 0x6014, "FT1")
    message, remedy = checked(links, monkeypatch, "ttyUSB0", known)
    assert "order of plugging in" in message
    assert "/by-id/" in remedy
    assert checked(links, monkeypatch, "serial/by-id/usb-1a86_USB_Serial-if00-port0", known)[1] == ""


@pytest.mark.parametrize("name", ["arm", "robots/arm"])
def test_the_name_of_a_udev_rule_is_that_of_one_port(
    links: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """It is what the warnings recommend where no link of ``by-path`` is there."""
    (links / name).parent.mkdir(exist_ok=True)
    (links / name).symlink_to(links / "ttyUSB0")
    two = [Port(str(links / f"ttyUSB{number}")) for number in range(2)]
    for ports in (two, two[:1], [Port(str(links / "ttyUSB0"), 0x0403, 0x6014, "FT1")]):
        message, remedy = checked(links, monkeypatch, name, *ports)
        assert message.endswith("arm, the name of a udev rule")
        assert remedy == ""


def test_a_port_that_is_none_of_usb_has_no_finding(links: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: [Port(str(links / "ttyS0"), None)])
    assert port_name("servos", "/dev/ttyS0", str(links / "ttyS0")) == []
