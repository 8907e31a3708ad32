"""What ``contid doctor`` finds about a serial port - name, rights, latency, owner - and behind it."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from serial.tools import list_ports

from contid.errors import DeviceError
from contid.hal import Bus, Finding, Sample
from contid.kit import serial_ports
from contid.kit.serial_ports import find_port, holders

#: Where the kernel describes serial ports.
TTYS: Final = Path("/sys/class/tty")
#: What to do about missing rights and slow adapters.
UDEV: Final = "install host/99-contid.rules, or join the group dialout; then plug the adapter in again"
#: Exchanges of `examine_bus`.
EXCHANGES: Final = 50


def port_findings(bus: str, pattern: str, path: str, udev: str) -> list[Finding]:
    """Findings about the port of a bus.

    Args:
        bus: its name.
        pattern: the ``port`` of the robot file.
        path: the port found.
        udev: the remedy for missing rights and slow adapters.
    """
    return [*port_name(bus, pattern, path), _permission(bus, path, udev), latency_timer(bus, path, udev)]


def _permission(bus: str, path: str, udev: str) -> Finding:
    good = os.access(path, os.R_OK | os.W_OK)
    return Finding(
        f"{bus} permission",
        good,
        f"{path} is {'readable and writable' if good else 'not accessible to this user'}",
        "" if good else udev,
    )


def latency_timer(bus: str, path: str, udev: str) -> Finding:
    """How long the adapter keeps received bytes back; adapters of FTDI do for 16 ms unless set otherwise."""
    timer = TTYS / Path(path).resolve().name / "device" / "latency_timer"
    subject = f"{bus} latency timer"
    try:
        value = int(timer.read_text())
    except (OSError, ValueError):
        return Finding(subject, True, "none on this adapter")
    remedy = "" if value <= 1 else f"{udev}; now: echo 1 | sudo tee {timer}"
    return Finding(subject, value <= 1, f"{value} ms of delay per read; 1 is right", remedy)


def owner(bus: str, path: str) -> Finding:
    """Other processes that have the port open as well, once it is open and locked."""
    others = holders(path)
    text = f"locked for contid; also open in {', '.join(others)}" if others else "no other process"
    return Finding(f"{bus} owner", True, text)


def examine_bus(bus: Bus, pattern: str, udev: str = UDEV) -> list[Finding]:
    """Findings about a bus and its port; moves nothing (`contid.hal.Diagnoses.doctor`).

    Args:
        bus: closed; it is opened, read and closed again.
        pattern: the ``port`` of the robot file.
        udev: the remedy for missing rights and slow adapters.
    """
    findings: list[Finding] = []
    try:
        path = find_port(bus.name, pattern)
        findings += port_findings(bus.name, pattern, path, udev)
        bus.open()
        findings.append(owner(bus.name, path))
        samples = [bus.exchange({}) for _ in range(EXCHANGES)]
    except DeviceError as error:
        return [*findings, Finding(f"{bus.name} port", False, error.message, error.remedy)]
    finally:
        bus.close()
    return [*findings, *(_axis(axis, [each[axis] for each in samples]) for axis in bus.axes)]


def _axis(axis: str, samples: Sequence[Sample]) -> Finding:
    """What an axis answered to several exchanges."""
    answers, newest = [each for each in samples if each.valid], samples[-1]
    text = f"{len(answers)} of {len(samples)} answers"
    if newest.value is not None:
        text += f", reads {newest.value:.4f}"
    if newest.voltage_v is not None:
        text += f", {newest.voltage_v:.1f} V"
    if newest.temperature_c is not None:
        text += f", {newest.temperature_c:.0f} deg C"
    if newest.fault:
        return Finding(axis, False, f"{text}, {newest.fault}", "remove the cause, then `contid clear-fault`")
    lost = len(answers) < len(samples)
    return Finding(
        axis, len(answers) > 0, text, "check cable, supply and latency" if lost else "", warning=lost
    )


def port_name(bus: str, pattern: str, path: str) -> list[Finding]:
    """Whether the name of a port is that of one adapter or socket; empty for a port that is none of USB.

    A link beside the device is taken for that of a udev rule, which its author made for one of them.

    Args:
        bus: its name.
        pattern: the ``port`` of the robot file.
        path: the port found.
    """
    real = str(Path(path).resolve())
    ports = [port for port in list_ports.comports() if port.vid is not None]
    own = next((port for port in ports if port.device == real), None)
    if own is None:
        return []
    subject, by_path = f"{bus} port name", _link("by-path", real)
    remedy = f"write port: {by_path}, which names the socket" if by_path else "name the socket by a udev rule"
    kind = (own.vid, own.pid, own.serial_number)
    equal = [port.device for port in ports if (port.vid, port.pid, port.serial_number) == kind]
    if "/by-path/" in pattern:
        return [Finding(subject, True, f"{pattern}, the name of its socket")]
    link = Path(pattern).expanduser()
    if link.is_symlink() and Path(real).parent in link.parents and "/by-id/" not in pattern:
        return [Finding(subject, True, f"{pattern}, the name of a udev rule")]
    if len(equal) > 1:
        message = f"{pattern} is not unique: {', '.join(sorted(equal))} are equal adapters with one name"
        return [Finding(subject, True, message, remedy, warning=True)]
    if not own.serial_number:
        message = f"{pattern}: its adapter has no serial number; a second one would get the same name"
        return [Finding(subject, True, message, remedy, warning=True)]
    if "/by-id/" not in pattern:
        by_id = _link("by-id", real)
        message = f"{pattern} depends on the order of plugging in"
        return [Finding(subject, True, message, f"write port: {by_id or by_path}", warning=True)]
    return [Finding(subject, True, f"{pattern}, the name of one adapter")]


def _link(folder: str, real: str) -> str:
    """The name of a device in a folder of `contid.kit.serial_ports.SERIAL`, "" without one."""
    links = sorted((serial_ports.SERIAL / folder).glob("*"))
    return next((str(link) for link in links if str(link.resolve()) == real), "")
