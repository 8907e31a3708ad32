"""``contid scan`` and ``contid firmware flash`` at the ports of Due boards."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import pytest
from click.testing import CliRunner

from contid_devices.dynamixel.scan import likely_ports
from contid_devices.firmware import command as firmware_command
from contid_devices.scan import command as scan_command
from contid_drivers.due.options import DueBusOptions, Role
from contid_emulate.due import DueEmulator

pytestmark = [pytest.mark.process, pytest.mark.realtime]


@dataclass(frozen=True)
class UsbEntry:
    """What pyserial lists of a USB port."""

    device: str
    vid: int
    pid: int
    serial_number: str = "1"


@pytest.fixture
def boards(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, DueEmulator]]:
    """A motor board at its native port, a pressure board at its programming port, which opening resets."""
    with ExitStack() as stack:
        made = {}
        ports = []
        for name, role, connection, vid, pid in (
            ("native", Role.MOTOR, "native", 0x2341, 0x003E),
            ("programming", Role.PRESSURE, "programming", 0x2A03, 0x003D),
        ):
            options = DueBusOptions(port=str(tmp_path / name), role=role, connection=connection)  # type: ignore[arg-type]
            made[name] = stack.enter_context(DueEmulator(options, [], tmp_path / f"{name}.journal"))
            ports.append(UsbEntry(str(made[name].port.resolve()), vid, pid))
        ports.append(UsbEntry(str(tmp_path / "uno"), 0x2341, 0x0043))
        monkeypatch.setattr("serial.tools.list_ports.comports", lambda: ports)
        yield made


def boots(journal: Path) -> int:
    return sum('"event": "boot"' in line for line in journal.read_text().splitlines())


@pytest.mark.parametrize("named", [False, True])
def test_a_scan_finds_native_boards_and_resets_none(
    boards: dict[str, DueEmulator], tmp_path: Path, named: bool
) -> None:
    ports = [str(board.port) for board in boards.values()] if named else []
    result = CliRunner().invoke(scan_command, [*ports, "--json"], catch_exceptions=False)
    (found,) = [json.loads(line) for line in result.stdout.splitlines()]
    assert found["driver"] == "due"
    assert found["model"] == "Arduino Due, motor board"
    assert found["address"] == bytes(range(0xE0, 0xF0)).hex()
    assert found["firmware"] == "1.7.2"
    assert boots(tmp_path / "programming.journal") == 1
    assert boots(tmp_path / "native.journal") == 1
    shown = CliRunner().invoke(scan_command, ports, catch_exceptions=False)
    assert "Arduino Due, motor board  firmware 1.7.2" in shown.stdout
    assert "0 baud" not in shown.stdout
    assert shown.stderr.count("not opened at servo rates") == (2 if named else 3)


def test_a_teensy_is_found_by_its_hello(
    boards: dict[str, DueEmulator], monkeypatch: pytest.MonkeyPatch
) -> None:
    port = UsbEntry(str(boards["native"].port.resolve()), 0x16C0, 0x0483)
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: [port])
    shown = CliRunner().invoke(scan_command, [], catch_exceptions=False)
    assert "Teensy, motor board  firmware 1.7.2" in shown.stdout
    assert shown.stderr.count("not opened at servo rates") == 1


def test_servo_ports_are_those_of_no_arduino(
    boards: dict[str, DueEmulator], monkeypatch: pytest.MonkeyPatch
) -> None:
    u2d2 = UsbEntry("/dev/ttyUSB7", 0x0403, 0x6014)
    monkeypatch.setattr(
        "serial.tools.list_ports.comports", lambda: [UsbEntry("/dev/ttyACM9", 0x2341, 0x003E), u2d2]
    )
    reported: list[str] = []
    assert likely_ports(reported.append) == ["/dev/ttyUSB7"]
    assert "/dev/ttyACM9" in reported[0]


def test_flash_names_the_device_behind_a_by_id_link(tmp_path: Path) -> None:
    device = tmp_path / "ttyACM3"
    device.touch()
    link = tmp_path / "usb-Arduino_Due-if00"
    link.symlink_to(device)
    binary = tmp_path / "contid_due.bin"
    binary.touch()
    shown = CliRunner().invoke(firmware_command, ["flash", str(link), "--binary", str(binary), "--dry-run"])
    assert "bossac --port=ttyACM3 " in shown.stdout
