"""The first exchange with the servos of a bus: every one is there, of its model, and answers."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from contid.errors import DeviceNotFoundError
from contid_drivers.dynamixel import duplicates
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.axis import Axis
from contid_drivers.dynamixel.client import NoAnswerError, ServoClient
from contid_drivers.dynamixel.models import model_name
from contid_drivers.dynamixel.options import DynamixelBusOptions
from contid_drivers.dynamixel.packets import sync_write

log = logging.getLogger(__name__)


def handshake(client: ServoClient, axes: Sequence[Axis], options: DynamixelBusOptions) -> None:
    """Find every servo; read its firmware and return delay.

    Raises:
        DeviceNotFoundError: a servo is missing or another model; lists expected and found.
    """
    lines, twice = [], False
    for axis in axes:
        model = client.ping(axis.device)
        found = "nothing" if model is None else model_name(model)
        if duplicates.count_answers(client.port, axis.device, duplicates.QUICK_READS).duplicated:
            found, twice = f"broken answers: {duplicates.CAUSE}", True
        if found != axis.options.model:
            lines.append(f"id {axis.device} ({axis.name}): expected {axis.options.model}, found {found}")
    if lines:
        present = ", ".join(
            f"id {device} {model_name(model)} firmware {firmware}"
            for device, (model, firmware) in sorted(client.broadcast_ping().items())
        )
        raise DeviceNotFoundError(
            client.bus,
            f"at {options.baud} baud: " + "; ".join(lines) + f"; on the bus: {present or 'none'}",
            duplicates.REMEDY if twice else "check power, ids and baud rate with `contid scan`",
        )
    for axis in axes:
        _make_it_answer(client, axis)
        axis.firmware = client.firmware(axis.device)
        axis.return_delay_s = client.read(axis.device, reg.RETURN_DELAY) * 2e-6
        if client.read(axis.device, reg.STATUS_RETURN_LEVEL) != reg.STATUS_RETURN_LEVEL.default:
            client.write(axis.device, reg.STATUS_RETURN_LEVEL, reg.STATUS_RETURN_LEVEL.default)


def _make_it_answer(client: ServoClient, axis: Axis) -> None:
    """Status Return Level (68) := 2 in a servo that answers pings only; such a write has no answer."""
    level, device = reg.STATUS_RETURN_LEVEL, axis.device
    try:
        client.read(device, level)
    except NoAnswerError:
        log.warning("%s: its Status Return Level is 0, it answers pings only; set to 2", client.name(device))
        client.port.flush()
        client.port.send(sync_write(level.address, 1, [(device, level.encode(level.default))]))
        client.port.drain()
