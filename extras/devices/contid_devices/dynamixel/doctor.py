"""``contid doctor`` for a servo bus: findings with remedies."""

from __future__ import annotations

import time
from collections.abc import Collection, Sequence
from typing import Final

from contid.errors import DeviceError
from contid.hal import AxisOnBus, Finding
from contid.kit.remembered import accept_remedy, memory_of
from contid.kit.serial_ports import find_port
from contid_driverkit.port_checks import owner, port_findings
from contid_drivers.dynamixel import arming, duplicates
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.axis import Axis
from contid_drivers.dynamixel.checks import identity, left_over
from contid_drivers.dynamixel.client import NoAnswerError, ServoClient
from contid_drivers.dynamixel.cycle_time import Slack
from contid_drivers.dynamixel.exchange.answers import AnswerCounts
from contid_drivers.dynamixel.exchange.block import PLAIN
from contid_drivers.dynamixel.exchange.cyclic import Cyclic
from contid_drivers.dynamixel.grip import read_own_limit
from contid_drivers.dynamixel.models import model_name
from contid_drivers.dynamixel.options import DynamixelBusOptions
from contid_drivers.dynamixel.port import ServoPort

HOT_C: Final = 60
#: Exchanges with all servos in a row, and the time after which there are enough of them.
EXCHANGES: Final = 200
EXCHANGES_S: Final = 1.0
_UDEV: Final = "install host/99-contid.rules (see docs/devices/dynamixel.md) and plug the adapter in again"


def examine(name: str, options: DynamixelBusOptions, axes: Sequence[AxisOnBus]) -> list[Finding]:
    """Examine without motion; problems are findings, not exceptions (`contid.hal.Diagnoses.doctor`)."""
    try:
        path = find_port(name, options.port)
    except DeviceError as error:
        return [Finding(f"{name} port", False, error.message, error.remedy)]
    findings = port_findings(name, options.port, path, _UDEV)
    try:
        port = ServoPort(name, path, options.baud, max(options.usb_latency_ms, 20.0) / 1e3)
    except DeviceError as error:
        return [*findings, Finding(f"{name} port", False, error.message, error.remedy)]
    try:
        findings.append(owner(name, path))
        client = ServoClient(name, port)
        for axis in axes:
            findings += _servo(client, Axis.of(axis, options), options)
        findings += _identity(client, path, axes, options)
        configured, found = [Axis.of(axis, options).device for axis in axes], set(client.broadcast_ping())
        findings += exchanges(client, [device for device in configured if device in found], options)
        findings.append(_others(client, found.difference(configured), configured))
    except DeviceError as error:
        findings.append(Finding(f"{name} port", False, error.message, error.remedy))
    finally:
        port.close()
    return findings


def _servo(client: ServoClient, axis: Axis, options: DynamixelBusOptions) -> list[Finding]:
    device, subject = axis.device, f"id {axis.device} ({axis.name})"
    model = client.ping(device)
    answers = duplicates.count_answers(client.port, device)
    if answers.duplicated:
        message = f"{answers.broken} answers broken: {duplicates.CAUSE}"
        return [Finding(f"{subject} answers", False, message, duplicates.REMEDY)]
    if model is None:
        remedy = "check its power and cable, then `contid scan`"
        return [Finding(subject, False, f"no answer at {options.baud} baud", remedy)]
    if not answers.single:
        message = "answers a ping, but no read: its Status Return Level (68) is 0"
        return [Finding(subject, True, message, "arming sets it to 2", warning=True)]
    try:
        return _examine_servo(client, axis, options, model, answers)
    except NoAnswerError as error:
        return [Finding(subject, False, f"answers badly: {error.message}", "check its cable and supply")]


def _examine_servo(
    client: ServoClient,
    axis: Axis,
    options: DynamixelBusOptions,
    model: int,
    answers: duplicates.AnswerCount,
) -> list[Finding]:
    device, subject = axis.device, f"id {axis.device}"
    expected, found = axis.options.model, model_name(model)
    firmware = client.read(device, reg.FIRMWARE)
    volts, hot = client.read(device, reg.PRESENT_VOLTAGE), client.read(device, reg.PRESENT_TEMPERATURE)
    errors = client.read(device, reg.HARDWARE_ERROR)
    mode = client.read(device, reg.OPERATING_MODE)
    kind = axis.model
    slow = firmware < reg.FAST_READ_FIRMWARE

    def finding(what: str, ok: bool, message: str, remedy: str) -> Finding:
        return Finding(f"{subject} {what}", ok, message, "" if ok else remedy)

    return [
        finding("model", found == expected, f"{found}, robot file: {expected}", "correct one of them"),
        Finding(
            f"{subject} firmware",
            True,
            f"{firmware}; fast reads need {reg.FAST_READ_FIRMWARE}",
            "the bus uses plain reads, which are slower; DYNAMIXEL Wizard updates it" if slow else "",
            warning=slow,
        ),
        _settings(client, axis, options),
        _protections(client, device),
        finding(
            "voltage",
            kind.supply_min_v <= volts / 10 <= kind.supply_max_v,
            f"{volts / 10:.1f} V",
            f"check supply and cable: {kind.supply_v:g} V nominal",
        ),
        finding("temperature", hot < HOT_C, f"{hot} deg C", "let it cool; check for a permanent load"),
        finding(
            "hardware error",
            errors == 0,
            reg.describe_hardware_error(errors) or "none",
            f"{reg.remedy_of_hardware_error(errors)}; then `clear-fault`",
        ),
        finding("operating mode", True, reg.MODE_NAMES.get(mode, str(mode)), ""),
        finding(
            "answers",
            answers.single == duplicates.READS,
            f"{answers.single} of {duplicates.READS} intact",
            "a bad cable, a weak supply, or noise",
        ),
    ]


def _settings(client: ServoClient, axis: Axis, options: DynamixelBusOptions) -> Finding:
    """Settings that differ from the robot file: arming writes them, unless torque locks the EEPROM."""
    subject = f"id {axis.device} settings"
    read_own_limit(client, axis)
    required = [*arming.settings(axis, options), (reg.STATUS_RETURN_LEVEL, reg.STATUS_RETURN_LEVEL.default)]
    found = [(register, arming.present(client, axis.device, register), value) for register, value in required]
    different = [each for each in found if each[1] not in (None, each[2])]
    if not different:
        return Finding(subject, True, "as in the robot file")
    message = ", ".join(f"{register.name} is {now}, not {value}" for register, now, value in different)
    locked = [register.name for register, _, _ in different if register.eeprom]
    if locked and client.read(axis.device, reg.TORQUE_ENABLE):
        remedy = "torque is on and locks them: support the robot and relax it, then arming writes them"
        return Finding(subject, False, message, remedy)
    return Finding(subject, True, message, "arming writes them", warning=True)


def _protections(client: ServoClient, device: int) -> Finding:
    """Limits that the robot file does not set, where another program has changed them."""
    changed = left_over.changed_limits(client, device)
    message = "; ".join(each.message for each in changed) or "those of a new servo"
    remedy = "; ".join(each.remedy for each in changed)
    return Finding(f"id {device} limits", True, message, remedy, warning=bool(changed))


def exchanges(client: ServoClient, devices: Sequence[int], options: DynamixelBusOptions) -> list[Finding]:
    """Answers to exchanges with ``devices``, with the time-outs of a run."""
    if not devices:
        return []
    port = client.port
    patient_s, port.latency_s = port.latency_s, options.usb_latency_ms / 1e3
    cyclic = Cyclic(port, devices, PLAIN, Slack(options.slack_ms), AnswerCounts())
    until = time.monotonic() + EXCHANGES_S
    counts = cyclic.answers.counts
    while counts.exchanges < EXCHANGES and time.monotonic() < until:
        cyclic.run({}, full=True)
    port.latency_s = patient_s
    bad = counts.late + counts.silent + counts.broken
    remedy = ""
    if counts.late:
        remedy = "set the adapter's latency timer to 1 ms, or raise usb_latency_ms"
    elif bad:
        remedy = "check cable, supply and the servos reported above"
    return [
        Finding(
            f"{client.bus} exchanges",
            True,
            f"{counts.exchanges} with {len(devices)} servos: "
            f"{counts.late} late, {counts.silent} silent, {counts.broken} broken answers",
            remedy,
            warning=bad > 0,
        )
    ]


def _identity(
    client: ServoClient, path: str, axes: Sequence[AxisOnBus], options: DynamixelBusOptions
) -> list[Finding]:
    """Whether the servos are those that the bus had before; empty for emulated ones, or silent ones."""
    memory = memory_of(client.bus, options.port, path, axes)
    if memory is None:
        return []
    subject = f"{client.bus} identity"
    try:
        problem = identity.examined(client, [Axis.of(axis, options) for axis in axes], memory)
    except NoAnswerError:
        return []
    if problem:
        return [Finding(subject, False, problem, accept_remedy(client.bus))]
    return [Finding(subject, True, "no other servos than before")]


def _others(client: ServoClient, others: Collection[int], configured: Collection[int]) -> Finding:
    subject, ids = f"{client.bus} others", ", ".join(map(str, sorted(others)))
    if moving := left_over.followers(client, others, configured):
        message, remedy = ("; ".join(column) for column in zip(*moving, strict=True))
        return Finding(subject, False, message, remedy)
    message = f"also on the bus: id {ids}" if others else "only the servos of the robot file"
    return Finding(subject, True, message)
