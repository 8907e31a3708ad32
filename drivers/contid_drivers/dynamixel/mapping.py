"""The indirect addresses of a servo: set to the registers of the exchange, and checked.

Where the indirect data begin depends on model and firmware. At a wrong address a servo answers with other
registers, which would pass for positions; so the block is compared with the registers it stands for.
"""

from __future__ import annotations

import logging
from typing import Final

from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.axis import Axis
from contid_drivers.dynamixel.client import ServoClient, ServoRefusedError
from contid_drivers.dynamixel.exchange.block import INDIRECT_ORDER

log = logging.getLogger(__name__)

INDIRECT_STARTS: Final = (208, 224)
#: Registers of the block that stand still at rest, and how far they may move between two reads.
_PROOFS: Final = (
    (reg.BUS_WATCHDOG, 0),
    (reg.HARDWARE_ERROR, 0),
    (reg.TORQUE_ENABLE, 0),
    (reg.PRESENT_VOLTAGE, 5),
    (reg.PRESENT_TEMPERATURE, 3),
)


def map_block(client: ServoClient, axis: Axis) -> int:
    """Point the indirect addresses at the block; returns where it begins, 0 when the servo cannot."""
    device, expected = axis.device, axis.model.block_start(axis.firmware)
    if not expected:
        return 0
    try:
        _write(client, device)
        for start in sorted(INDIRECT_STARTS, key=lambda each: each != expected):
            if _proven(client, device, start):
                return start
    except ServoRefusedError as error:
        log.info("%s: its indirect addresses stay: %s", client.name(device), error.message)
    return 0


def _write(client: ServoClient, device: int) -> None:
    """Write the addresses that differ; with torque on some firmware refuses."""
    found = client.read_block(device, reg.INDIRECT_ADDRESS, 2 * len(INDIRECT_ORDER))
    for i, address in enumerate(INDIRECT_ORDER):
        if int.from_bytes(found[2 * i : 2 * i + 2], "little") != address:
            register = next(r for r in reg.TABLE if r.address == reg.INDIRECT_ADDRESS + 2 * i)
            client.write(device, register, address)


def _proven(client: ServoClient, device: int, start: int) -> bool:
    """Whether the block at ``start`` holds what its registers hold."""
    try:
        block = client.read_block(device, start, len(INDIRECT_ORDER))
    except ServoRefusedError:
        return False
    for register, change in _PROOFS:
        byte = block[INDIRECT_ORDER.index(register.address)]
        if abs(byte - (client.read(device, register) & 0xFF)) > change:
            return False
    return True
