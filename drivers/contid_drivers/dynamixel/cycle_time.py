"""Time of one exchange on the wire, from baud rate, block and ids, and the tick rate it allows.

    sync write of the goals + sync read + answers + return delays, 10 bits per byte

Byte stuffing is left out (it is rare), so the wire never takes less. `Slack` is the extra waiting time of an
exchange in which nothing arrived: a stall of the host, not a silent servo.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, Literal

from contid.hal import ExchangeTime
from contid_drivers.dynamixel.exchange.block import INDIRECT, PLAIN
from contid_drivers.dynamixel.exchange.fast_answer import HEAD as FAST_HEAD
from contid_drivers.dynamixel.exchange.fast_answer import PART_OVERHEAD
from contid_drivers.dynamixel.models import BY_NAME, LAST_FIRMWARE_AT_208
from contid_drivers.dynamixel.options import DynamixelAxisOptions, DynamixelBusOptions
from contid_drivers.dynamixel.packets import STATUS_OVERHEAD, sync_read, sync_write

BITS_PER_BYTE: Final = 10
GOAL_SIZE: Final = 4
#: Firmware before and after the change of the indirect data of the small servos.
_FIRMWARES: Final = (LAST_FIRMWARE_AT_208, LAST_FIRMWARE_AT_208 + 1)
#: A scheduler tick of a kernel at 250 Hz: a process may get its bytes this much later.
SLACK_MIN_S: Final = 4.2e-3
SLACK_MAX_S: Final = 20e-3
#: Exchanges per window; its second largest lateness is the 99.9th percentile.
WINDOW: Final = 1000
#: Factor on the measured percentile: larger latenesses are rare, but not much larger.
MARGIN: Final = 1.5


def bytes_on_wire(ids: Sequence[int], size: int, fast: bool) -> int:
    """Bytes of one exchange with a block of ``size`` bytes per servo."""
    goals = len(sync_write(0, GOAL_SIZE, [(device, bytes(GOAL_SIZE)) for device in ids]))
    count = len(ids)
    answers = FAST_HEAD + count * (size + PART_OVERHEAD) if fast else count * (size + STATUS_OVERHEAD)
    return goals + len(sync_read(0, size, ids)) + answers


def exchange_time(options: DynamixelBusOptions, axes: Sequence[DynamixelAxisOptions]) -> ExchangeTime:
    """Shortest and longest time of an undisturbed exchange; see `contid.hal.Paces`.

    The longest includes the adapter's allowance, and plain reads even where fast ones are allowed: an old
    firmware, or a lost answer, makes the bus use them. Models whose indirect data begin at different
    addresses need the plain block; of the small servos the firmware decides.
    """
    ids = [axis.id for axis in axes]
    models = [BY_NAME[axis.model] for axis in axes]
    starts = [{model.block_start(firmware) for firmware in _FIRMWARES} for model in models]
    # The layouts with which an exchange is shortest and longest, over all firmwares.
    shortest = INDIRECT if set.intersection(*starts) - {0} else PLAIN
    longest = INDIRECT if len(set.union(*starts)) == 1 or len(set(map(frozenset, starts))) == 1 else PLAIN
    if shortest is PLAIN:
        longest = PLAIN
    byte_s = BITS_PER_BYTE / options.baud
    delay_s = options.return_delay_us / 1e6

    def plain_s(size: int) -> float:
        return bytes_on_wire(ids, size, fast=False) * byte_s + len(ids) * delay_s

    fast_s = bytes_on_wire(ids, shortest.full, fast=True) * byte_s + delay_s
    least_s = plain_s(shortest.full) if options.fast_read == "off" else min(plain_s(shortest.full), fast_s)
    what = f"{len(ids)} servos at {options.baud} baud"
    return ExchangeTime(least_s, plain_s(longest.full) + options.usb_latency_ms / 1e3, what)


class Slack:
    """The slack of one bus, fixed or from the lateness of the answers so far.

    Args:
        slack_ms: slack of the robot file.
    """

    def __init__(self, slack_ms: float | Literal["auto"]) -> None:
        self._learns = slack_ms == "auto"
        #: Time to wait beyond the time-out [s].
        self.seconds = SLACK_MIN_S if slack_ms == "auto" else slack_ms / 1e3
        self._count = 0
        #: The two largest latenesses of this window, and the second largest of the window before [s].
        self._largest = self._second = self._before = 0.0

    def record(self, late_s: float) -> None:
        """Count an exchange whose last answer came ``late_s`` after its time on the wire."""
        if late_s > self._second:
            self._largest, self._second = max(self._largest, late_s), min(self._largest, late_s)
            self._learn()
        self._count += 1
        if self._count >= WINDOW:
            self._count, self._before = 0, self._second
            self._largest = self._second = 0.0
            self._learn()

    def _learn(self) -> None:
        """The slack from the 99.9th percentile of the lateness in this window and the one before."""
        if self._learns:
            percentile_s = max(self._second, self._before)
            self.seconds = min(max(MARGIN * percentile_s, SLACK_MIN_S), SLACK_MAX_S)
