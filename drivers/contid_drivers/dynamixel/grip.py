"""Live limits of the current: an axis in current-based position mode pushes with a share of its limit.

Goal Current (102) is written by sync write, which has no answer, so it is repeated: in the exchanges after a
change, and now and then, because a servo that missed it would push too hard.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.axis import Axis
from contid_drivers.dynamixel.client import ServoClient
from contid_drivers.dynamixel.packets import sync_write

#: Exchanges after a change that carry the currents.
REPEATS: Final = 3
#: One exchange in this many carries them as well, while one differs from the robot file.
EVERY: Final = 20
CURRENT_BASED: Final = reg.MODE_NUMBERS["current_based_position"]


def limit_ma(axis: Axis) -> float:
    """Greatest current of an axis [mA] that its mode limits while it moves; 0 when it limits none."""
    if axis.operating_mode != CURRENT_BASED:
        return 0.0
    return min(axis.options.goal_current_ma or axis.greatest_ma, axis.greatest_ma)


def read_own_limit(client: ServoClient, axis: Axis) -> None:
    """Read the limits that the servo has; a Goal Current or Goal PWM above them is refused."""
    axis.own_pwm = client.read(axis.device, reg.PWM_LIMIT)
    if axis.model.ma_per_unit is not None:
        own_ma = axis.model.ma_per_unit * client.read(axis.device, reg.CURRENT_LIMIT)
        axis.greatest_ma = axis.options.current_limit_ma or own_ma or axis.model.current_limit_ma


def goal_current(axis: Axis) -> int:
    """Goal Current of an axis for its share [units]."""
    return axis.model.to_units(limit_ma(axis) * axis.effort_share)


class CurrentShare:
    """Decides which exchange carries the currents.

    Attributes:
        axes: whose current is limited.
    """

    def __init__(self, axes: Iterable[Axis]) -> None:
        self.axes = [axis for axis in axes if limit_ma(axis)]
        self._left = 0
        self._count = 0

    def limits(self) -> dict[str, float]:
        """Greatest effort by axis [A]; axes without a limit are left out."""
        return {axis.name: limit_ma(axis) / 1e3 for axis in self.axes}

    def change(self, shares: Mapping[str, float]) -> None:
        """Take new shares of the limits, by axis."""
        for axis in self.axes:
            axis.effort_share = shares.get(axis.name, axis.effort_share)
        self._left = REPEATS

    def packet(self) -> bytes:
        """What this exchange sends before its goals; empty for nothing."""
        enabled = [axis for axis in self.axes if axis.enabled]
        self._count += 1
        due = self._count % EVERY == 0 and any(axis.effort_share != 1.0 for axis in enabled)
        if not enabled or not (self._left or due):
            return b""
        self._left = max(self._left - 1, 0)
        encode = reg.GOAL_CURRENT.encode
        values = [(axis.device, encode(goal_current(axis))) for axis in enabled]
        return sync_write(reg.GOAL_CURRENT.address, reg.GOAL_CURRENT.size, values)
