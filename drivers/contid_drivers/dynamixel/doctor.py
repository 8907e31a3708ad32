"""What is wrong with a servo bus or its host, each with its remedy: ``contid doctor``."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from contid.errors import DeviceError
from contid.hal import AxisOnBus, Finding
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.axis import Axis
from contid_drivers.dynamixel.options import DynamixelBusOptions
from contid_drivers.dynamixel.port import BlockingPort
from contid_drivers.dynamixel.protocol import NoAnswerError, ServoClient
from contid_drivers.serial_ports import find_port, holders

HOT_C: Final = 60
LOW_DECIVOLT: Final = 37
#: Reads of a free-running counter that show two servos answering to one id.
DUPLICATE_READS: Final = 12
_UDEV: Final = "install udev/99-contid.rules (see docs/dynamixel.md) and plug the adapter in again"


def examine(name: str, options: DynamixelBusOptions, axes: Sequence[AxisOnBus]) -> list[Finding]:
    """See `contid.hal.Diagnoses.doctor`."""
    try:
        path = find_port(name, options.port)
    except DeviceError as error:
        return [Finding(f"{name} port", False, error.message, error.remedy)]
    findings = [_permission(name, path), _latency(name, path)]
    port = BlockingPort(name, path, options.baud, max(options.usb_latency_ms, 20.0) / 1e3)
    try:
        port.open()
    except DeviceError as error:
        return [*findings, Finding(f"{name} port", False, error.message, error.remedy)]
    try:
        others = holders(path)
        owner = (
            f"locked for contid; also open in {', '.join(others)}" if others else "nobody else has it open"
        )
        findings.append(Finding(f"{name} owner", True, owner))
        client = ServoClient(name, port)
        for axis in axes:
            findings += _servo(client, Axis.of(axis, options), options)
        findings.append(_strangers(client, axes, options))
    except DeviceError as error:
        findings.append(Finding(f"{name} port", False, error.message, error.remedy))
    finally:
        port.close()
    return findings


def _permission(name: str, path: str) -> Finding:
    good = os.access(path, os.R_OK | os.W_OK)
    return Finding(
        f"{name} permission",
        good,
        f"{path} is {'readable and writable' if good else 'not ours'}",
        "" if good else _UDEV,
    )


def _latency(name: str, path: str) -> Finding:
    timer = Path("/sys/class/tty") / Path(path).resolve().name / "device" / "latency_timer"
    subject = f"{name} latency timer"
    try:
        value = int(timer.read_text())
    except (OSError, ValueError):
        return Finding(subject, True, "this adapter has none")
    remedy = "" if value <= 1 else f"{_UDEV}; now: echo 1 | sudo tee {timer}"
    return Finding(subject, value <= 1, f"{value} ms of delay per read; 1 is right", remedy)


def _servo(client: ServoClient, axis: Axis, options: DynamixelBusOptions) -> list[Finding]:
    device, subject = axis.device, f"id {axis.device} ({axis.name})"
    model = client.ping(device)
    if model is None:
        remedy = "check its power and cable, then `contid scan`"
        return [Finding(subject, False, f"no answer at {options.baud} baud", remedy)]
    try:
        return _looked_at(client, axis, options, model)
    except NoAnswerError as error:
        twice = "two servos with this id? Disconnect one and give it another (`contid servo set-id`)"
        return [Finding(subject, False, f"answers badly: {error.message}", twice)]


def _looked_at(client: ServoClient, axis: Axis, options: DynamixelBusOptions, model: int) -> list[Finding]:
    device, subject = axis.device, f"id {axis.device}"
    expected, found = axis.options.model, reg.MODELS.get(model, f"model {model}")
    firmware, delay_us = client.firmware(device), client.read(device, reg.RETURN_DELAY) * 2
    volts, hot = client.read(device, reg.PRESENT_VOLTAGE), client.read(device, reg.PRESENT_TEMPERATURE)
    errors = client.read(device, reg.HARDWARE_ERROR)
    mode = client.read(device, reg.OPERATING_MODE)
    bad = sum(not _one_voice(client, device) for _ in range(DUPLICATE_READS))

    def finding(what: str, ok: bool, message: str, remedy: str) -> Finding:
        return Finding(f"{subject} {what}", ok, message, "" if ok else remedy)

    return [
        finding(
            "model", found == expected, f"{found}, the robot file says {expected}", "correct one of them"
        ),
        finding(
            "firmware",
            firmware >= reg.FAST_READ_FIRMWARE,
            f"{firmware}; fast reads need {reg.FAST_READ_FIRMWARE}",
            "update it with Dynamixel Wizard, or leave fast_read off",
        ),
        finding(
            "return delay",
            delay_us <= options.return_delay_us,
            f"{delay_us} us, the robot file says {options.return_delay_us}",
            "it is written when the robot is armed",
        ),
        finding(
            "voltage",
            volts > LOW_DECIVOLT,
            f"{volts / 10:.1f} V",
            "check supply and cable: 5 V are recommended",
        ),
        finding("temperature", hot < HOT_C, f"{hot} deg C", "let it cool; check for a load that never rests"),
        finding(
            "hardware error",
            errors == 0,
            reg.hardware_error_in_words(errors) or "none",
            "remove the cause, `clear-fault`",
        ),
        finding(
            "operating mode",
            True,
            reg.MODE_NAMES.get(mode, str(mode)),
            "",
        ),
        finding(
            "answers",
            bad == 0,
            f"{DUPLICATE_READS - bad} of {DUPLICATE_READS} intact",
            "two servos with this id, or a bad cable: connect one at a time and `contid servo set-id`",
        ),
    ]


def _one_voice(client: ServoClient, device: int) -> bool:
    """Two servos with one id talk at once; where their positions or counters differ, the answer breaks."""
    try:
        client.read_block(device, reg.REALTIME_TICK.address, 16, tries=1)
    except NoAnswerError:
        return False
    return True


def _strangers(client: ServoClient, axes: Sequence[AxisOnBus], options: DynamixelBusOptions) -> Finding:
    known = {Axis.of(axis, options).device for axis in axes}
    others = sorted(set(client.broadcast_ping()) - known)
    message = (
        f"also on the bus: id {', '.join(map(str, others))}"
        if others
        else "nobody but the robot file's servos"
    )
    return Finding(f"{client.bus} others", True, message)
