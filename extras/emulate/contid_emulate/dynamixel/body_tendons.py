"""Tendons of a body that moves, on the spools of emulated servos: their currents show how it swings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from contid_drivers.dynamixel import registers as reg
from contid_emulate.dynamixel.servo import Servo
from contid_emulate.dynamixel.tendons import TendonPlant

#: By so much is a snapped tendon unwound [ticks]: no body bends as far.
_UNWOUND: Final = 20.0 * reg.TICKS_PER_REV


@dataclass(frozen=True)
class Spool:
    """The spool of one axis.

    Attributes:
        axis: its name on the bus.
        ma_per_n: current that a tension takes [mA/N], signed like the rotation that winds in.
        rest_rad: angle of the shaft where the robot is at rest.
    """

    axis: str
    ma_per_n: float
    rest_rad: float


class BodyTendons(TendonPlant):
    """Loads the shafts of servos with the tensions of a moving body.

    Args:
        servos: one per tendon.
        ma_per_n: of each spool, see `Spool`.
        standing: loads the shafts as long as a tube holds the robot straight; None without a tube.

    Attributes:
        tensions_n: tensions of the body, renewed by what moves it.
    """

    def __init__(
        self, servos: Sequence[Servo], ma_per_n: Sequence[float], standing: TendonPlant | None
    ) -> None:
        none = (0.0,) * len(servos)
        super().__init__(
            servos, [1 if each > 0.0 else -1 for each in ma_per_n], none, np.abs(ma_per_n).tolist()
        )
        self.tensions_n: NDArray[np.float64] = np.zeros(len(servos))
        self._standing = standing
        self.held = standing is not None and standing.held

    def tensions_ma(self) -> NDArray[np.float64]:
        """Tension of every tendon [mA]."""
        if self.held and self._standing is not None:
            return self._standing.tensions_ma()
        return np.asarray(self._stiffness * self.tensions_n, dtype=np.float64)

    def snap(self, number: int, on: bool = True) -> None:
        """Tendon ``number`` breaks, or is tied again."""
        super().snap(number, on)
        if self._standing is not None:
            self._standing.snap(number, on)

    def unwound(self, servo: Servo) -> float:
        """What a servo has unwound of a snapped tendon [ticks]; 0 for others."""
        for number, each in enumerate(self._servos):
            if each is servo and self._stiffness[number] == 0.0:
                return float(-self._winding[number] * _UNWOUND)
        return 0.0
