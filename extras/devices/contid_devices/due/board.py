"""``contid doctor`` and ``contid scan`` for a Due or Teensy board."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Final

from contid.errors import ContidError
from contid.hal import AxisOnBus, Finding, FoundDevice, Report
from contid.kit.remembered import memory_of
from contid.kit.serial_ports import find_port, usb_ports
from contid.units import BAR
from contid_driverkit.clock import MonotonicClock
from contid_driverkit.port_checks import port_name
from contid_drivers.due import identity
from contid_drivers.due.bus import DueBus
from contid_drivers.due.options import DueBusOptions, Role
from contid_drivers.due.session import ask_hello

#: Exchanges timed by the doctor.
_EXCHANGES = 50


def doctor(name: str, options: DueBusOptions, axes: Sequence[AxisOnBus]) -> list[Finding]:
    """Port, hello, configuration and the time of an exchange; arms nothing and moves nothing."""
    try:
        path = find_port(name, options.port)
    except ContidError as error:
        remedy = f"plug the board in, or correct buses.{name}.port"
        return [Finding(f"{name} port", False, str(error), remedy)]
    findings = [Finding(f"{name} port", True, f"{path} -> {Path(path).resolve()}")]
    findings += port_name(name, options.port, path)
    with closing(DueBus(name, options, axes, MonotonicClock())) as bus:
        try:
            bus.open()
            hello = bus.hello
            version = ".".join(map(str, hello.firmware))
            started = (
                f"firmware {version}, started {hello.boot} times, last by {hello.cause.message}, up for "
                f"{hello.uptime_ms / 1000:.1f} s; chip {hello.unique_id}; pins {hello.pins}"
            )
            findings.append(Finding(f"{name} board", True, started))
            accepted = f"accepted, safe state = start state on {len(axes)} axes"
            findings.append(Finding(f"{name} configuration", True, accepted))
            findings.extend(_timing(name, options, bus))
        except ContidError as error:
            findings.append(Finding(f"{name} board", False, str(error), "see the message"))
    return findings


def _timing(name: str, options: DueBusOptions, bus: DueBus) -> list[Finding]:
    times = []
    missed = 0
    samples = {}
    for _ in range(_EXCHANGES):
        start = time.monotonic()
        samples = dict(bus.exchange({}))
        times.append(time.monotonic() - start)
        missed += not all(sample.valid for sample in samples.values())
    times.sort()
    median_ms, worst_ms = times[len(times) // 2] * 1e3, times[-1] * 1e3
    well = missed == 0 and worst_ms < options.watchdog_ms / 2
    findings = [
        Finding(
            f"{name} exchange",
            well,
            f"median {median_ms:.2f} ms, worst {worst_ms:.2f} ms, {missed} of {_EXCHANGES} incomplete",
            "" if well else "use the native port, avoid USB hubs, or raise latency_ms",
        )
    ]
    if (newest := bus.telemetry) is not None:
        edges = sum(each.missed_edges for each in newest.channels.values())
        findings.append(
            Finding(
                f"{name} counters",
                True,
                f"watchdog stopped {newest.trips} channels since the start, longest gap "
                f"{newest.longest_ms} of {options.watchdog_ms} ms; {edges} encoder edges missed; "
                f"{newest.bad_frames} damaged frames",
            )
        )
    for axis, sample in samples.items():
        lost = sample.fault.startswith("position lost")
        remedy = "" if lost or not sample.fault else "remove the cause, then clear-fault"
        reads = f"reads {_reading(options.role, sample.value)}"
        findings.append(Finding(axis, not sample.fault, sample.fault or reads, remedy))
    return findings


def _reading(role: Role, value: float | None) -> str:
    if value is None:
        return "nothing"
    return f"{math.degrees(value):.2f} deg" if role is Role.MOTOR else f"{value / BAR:.3f} bar"


def accept(name: str, options: DueBusOptions, axes: Sequence[AxisOnBus], report: Report) -> None:
    """Take the board that answers as that of the bus (`contid.hal.Identifies.accept`)."""
    memory = memory_of(name, options.port, find_port(name, options.port), axes)
    if memory is None:
        report(f"{name}: emulated devices are not remembered")
        return
    report(f"{name}: {identity.accept(ask_hello(name, options), memory)}")


#: A board answers within milliseconds; one that starts at the same moment within this time.
_HELLO_MS: Final = 500.0
#: Folder of pseudo-terminals: emulated boards, when named.
_PTYS: Final = Path("/dev/pts")


def scan(ports: Sequence[str], report: Report) -> list[FoundDevice]:
    """Boards that answer a hello; nothing else is sent, and no programming port is opened.

    Args:
        ports: empty for every native port; a named port counts when it is one, or a pseudo-terminal.
        report: takes lines about ports that do not answer.
    """
    usb = {Path(port.path).resolve(): port for port in usb_ports()}
    native = {real: port.path for real, port in usb.items() if port.native}
    given = {path: Path(path).resolve() for path in ports} or {path: real for real, path in native.items()}
    found = []
    for path, real in given.items():
        if real not in native and (real in usb or real.parent != _PTYS):
            continue
        try:
            # The role is that of the answer; hello asks for none.
            hello = ask_hello(path, DueBusOptions(port=path, role=Role.MOTOR, hello_ms=_HELLO_MS))
        except ContidError as error:
            report(str(error))
            continue
        version = ".".join(map(str, hello.firmware))
        board = "Teensy" if real in usb and usb[real].teensy else "Arduino Due"
        found.append(FoundDevice(path, 0, hello.unique_id, f"{board}, {hello.role_name} board", version))
    return found
