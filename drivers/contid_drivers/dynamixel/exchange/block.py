"""The block of registers that an exchange reads from every servo, and its decoding.

It holds, through indirect addresses where the servo has them::

    98 watchdog | 126 current 2, velocity 4, position 4 | 144 voltage, low byte  <- every exchange
    70 hardware error | 64 torque enable | 146 temperature                       <- every n-th as well

The low byte is the whole voltage (an XL330 stays below 25.6 V). It is 0 only when a reset lost the mapping.
Without indirect addresses the plain block 98..146 is read, which lacks the torque enable.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from contid_drivers.dynamixel import registers as reg

#: Bytes before a block of plain registers that can be read with it.
BEFORE: Final = 24

#: Register addresses in the order of the indirect block.
INDIRECT_ORDER: Final = (98, *range(126, 136), 144, 70, 64, 146)


class ServoReading(NamedTuple):
    """A decoded block; None for registers this exchange did not read.

    Attributes:
        current: current in units of the model.
        velocity: velocity in units of 0.229 rpm.
        position: count of the servo; 4096 per turn.
        alert: the status packet reports a hardware error.
        watchdog: value of Bus Watchdog, in units of 20 ms.
        voltage_low: low byte of the input voltage; 0 after a reset, which clears the indirect addresses.
        voltage: input voltage in units of 0.1 V.
        hardware_error: bits of Hardware Error Status.
        torque: torque is on.
        temperature: [deg C].
        tick: Realtime Tick [ms], from 0 after a reset, modulo `reg.REALTIME_TICKS`.
    """

    current: int
    velocity: int
    position: int
    alert: bool
    watchdog: int | None = None
    voltage_low: int | None = None
    voltage: int | None = None
    hardware_error: int | None = None
    torque: bool | None = None
    temperature: int | None = None
    tick: int | None = None


@dataclass(frozen=True, slots=True)
class CyclicLayout:
    """Address of the block, and its bytes in a lean and in a full exchange."""

    address: int
    lean: int
    full: int
    indirect: bool = False


_LEAN: Final = struct.Struct("<BhiiB")
_PLAIN: Final = struct.Struct("<B21xH4xhii8xHB")
INDIRECT: Final = CyclicLayout(208, _LEAN.size, len(INDIRECT_ORDER), indirect=True)
INDIRECT_224: Final = CyclicLayout(224, _LEAN.size, len(INDIRECT_ORDER), indirect=True)
PLAIN: Final = CyclicLayout(98, _PLAIN.size, _PLAIN.size)


def common_layout(starts: Sequence[int]) -> CyclicLayout:
    """The layout of a bus whose servos have their indirect data at ``starts``; 0 for none.

    A sync read has one address for all: with different starts the plain block is read.
    """
    same = starts[0] if len(set(starts)) == 1 else 0
    return next((each for each in (INDIRECT, INDIRECT_224) if each.address == same), PLAIN)


@dataclass(frozen=True, slots=True)
class Block:
    """One read: its layout, its place, and the bytes to skip before the layout begins."""

    layout: CyclicLayout
    address: int
    size: int
    skip: int = 0

    def decode(self, data: bytes, alert: bool) -> ServoReading:
        """Decode an answer of this length."""
        skip, layout = self.skip, self.layout
        if not layout.indirect:
            watchdog, tick, current, velocity, position, voltage, temperature = _PLAIN.unpack_from(data, skip)
            return ServoReading(
                current,
                velocity,
                position,
                alert,
                watchdog,
                None,
                voltage,
                temperature=temperature,
                tick=tick,
            )
        watchdog, current, velocity, position, low = _LEAN.unpack_from(data, skip)
        if self.size - skip < layout.full:
            return ServoReading(current, velocity, position, alert, watchdog, low)
        error, torque, temperature = data[skip + 12 : skip + 15]
        return ServoReading(
            current, velocity, position, alert, watchdog, low, low, error, bool(torque), temperature
        )


def numbered_blocks(layout: CyclicLayout) -> list[Block]:
    """Blocks of distinct lengths, also distinct from the usual ones; short ones first.

    Beyond the mapped bytes the indirect data have few spare ones, so the plain block follows.
    """
    if not layout.indirect:
        return [Block(layout, layout.address - n, layout.full + n, n) for n in range(1, BEFORE + 1)]
    sizes = set(range(layout.lean, reg.INDIRECT_COUNT + 1)) - {layout.lean, layout.full}
    return [Block(layout, layout.address, size) for size in sorted(sizes)] + numbered_blocks(PLAIN)
