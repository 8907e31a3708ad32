"""Time of one exchange on the wire, from baud rate, block and ids, and the tick rate it allows.

    sync write of the goals + sync read + answers + return delays, 10 bits per byte

Byte stuffing is left out (it is rare), so the wire never takes less.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from contid.hal import ExchangeTime
from contid_drivers.dynamixel.cyclic import INDIRECT
from contid_drivers.dynamixel.options import DynamixelBusOptions
from contid_drivers.dynamixel.packets import STATUS_OVERHEAD, sync_read, sync_write

BITS_PER_BYTE: Final = 10
#: Bytes of a fast answer before the parts of the servos, and around the block of each.
FAST_HEADER: Final = 8
FAST_OVERHEAD: Final = 4
GOAL_SIZE: Final = 4


def bytes_on_wire(ids: Sequence[int], size: int, fast: bool) -> int:
    """Bytes of one exchange with a block of ``size`` bytes per servo."""
    goals = len(sync_write(0, GOAL_SIZE, [(device, bytes(GOAL_SIZE)) for device in ids]))
    count = len(ids)
    answers = FAST_HEADER + count * (size + FAST_OVERHEAD) if fast else count * (size + STATUS_OVERHEAD)
    return goals + len(sync_read(0, size, ids)) + answers


def exchange_time(options: DynamixelBusOptions, ids: Sequence[int]) -> ExchangeTime:
    """Shortest and longest time of an undisturbed exchange; see `contid.hal.Paces`.

    The longest includes the adapter's allowance, and plain reads even where fast ones are allowed: an old
    firmware, or a lost answer, makes the bus use them.
    """
    byte_s = BITS_PER_BYTE / options.baud
    delay_s = options.return_delay_us / 1e6
    plain_s = bytes_on_wire(ids, INDIRECT.full, fast=False) * byte_s + len(ids) * delay_s
    fast_s = bytes_on_wire(ids, INDIRECT.full, fast=True) * byte_s + delay_s
    least_s = plain_s if options.fast_read == "off" else min(plain_s, fast_s)
    what = f"{len(ids)} servos at {options.baud} baud"
    return ExchangeTime(least_s, plain_s + options.usb_latency_ms / 1e3, what)
