"""Tendons and backbone on the spools of emulated servos: pretension, slack and a snap are seen on the wire.

Tendon i has wound ``w_i`` ticks beyond the position where it is just taut on the straight robot. Bends Theta
and tensions ``T = max(0, k (w - G Theta))`` balance the backbone, ``G^T T = K Theta``: the elastic energy of
both is least. A slack tendon does not push. Tension is in mA of its servo, all else in units of ticks.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from contid_drivers.dynamixel.emulator.servo import Servo

# Sets of taut tendons tried for one balance.
_SETS = 30


class TendonPlant:
    """Loads the shafts of servos; tendons begin where ``taut_ticks`` are.

    Args:
        servos: one per tendon.
        winding: 1 or -1 for each: sense of rotation that winds in.
        taut_ticks: position of each servo at which its tendon is just taut on the straight robot.
        ma_per_tick: stiffness k of each tendon.
        pull_matrix: G, ticks by bends, shape ``(tendons, bends)``; without it tendons are on their own.
        bending: K of each bend [mA tick per unit of bend^2].
    """

    def __init__(
        self,
        servos: Sequence[Servo],
        winding: Sequence[int],
        taut_ticks: Sequence[float],
        ma_per_tick: Sequence[float],
        pull_matrix: NDArray[np.float64] | None = None,
        bending: Sequence[float] = (),
    ) -> None:
        self._servos = tuple(servos)
        self._winding = np.array(winding, dtype=float)
        self._taut = np.array(taut_ticks, dtype=float)
        self._stiffness = np.array(ma_per_tick, dtype=float)
        self._matrix = np.zeros((len(servos), 0)) if pull_matrix is None else np.asarray(pull_matrix)
        self._bending = np.diag(np.array(bending, dtype=float))
        for number, servo in enumerate(self._servos):
            servo.motion.load = lambda number=number: self.load_ma(number)

    def snap(self, number: int) -> None:
        """Tendon ``number`` breaks."""
        self._stiffness[number] = 0.0

    def tensions_ma(self) -> NDArray[np.float64]:
        """Tension of every tendon, 0 where it is slack [mA]."""
        position = np.array([servo.motion.position for servo in self._servos])
        wound = self._winding * (position - self._taut)
        taut = (wound > 0.0) & (self._stiffness > 0.0)
        stretch = wound
        for _ in range(_SETS if self._matrix.shape[1] else 0):
            weighted = self._matrix.T * np.where(taut, self._stiffness, 0.0)
            bends = np.linalg.solve(weighted @ self._matrix + self._bending, weighted @ wound)
            stretch = wound - self._matrix @ bends
            if np.array_equal(taut, now := (stretch > 0.0) & (self._stiffness > 0.0)):
                break
            taut = now
        return np.asarray(self._stiffness * np.maximum(stretch, 0.0), dtype=np.float64)

    def load_ma(self, number: int) -> float:
        """Current with which tendon ``number`` turns its servo back; its sign is that of the rotation."""
        return float(-self._winding[number] * self.tensions_ma()[number])
