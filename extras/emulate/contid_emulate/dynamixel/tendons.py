"""Tendons and backbone on the spools of emulated servos: their currents show pretension, slack and a snap.

Tendon i has wound ``w_i`` ticks beyond the position where it is just taut on the straight robot. Bends Theta
and tensions ``T = max(0, k (w - G Theta))`` balance the backbone, ``G^T T = K Theta``: the elastic energy of
both is least. A slack tendon does not push.

Units are those of the servos: what a tendon has wound is in ticks of its servo, a tension is the current [mA]
that the servo needs for it, so k is in mA/tick. Bends are in any unit, such as rad: G is then in ticks/rad,
and K in mA tick/rad^2.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from contid_emulate.dynamixel.servo import Servo

#: Newton steps of one balance at most; each has another set of taut tendons.
_MAX_STEPS = 30


class TendonPlant:
    """Loads the shafts of servos with the tensions of their tendons.

    Args:
        servos: one per tendon.
        winding: 1 or -1 for each servo: sense of rotation that winds its tendon in.
        taut_ticks: position of each servo at which its tendon is just taut on the straight robot [ticks].
        ma_per_tick: stiffness k of each tendon [mA/tick].
        pull_matrix: G, ticks per bend, shape ``(tendons, bends)``; without it the robot stays straight.
        bending: stiffness K of each bend [mA tick per square of a bend].

    Attributes:
        held: True while a tube holds the robot straight.
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
        self._intact_stiffness = self._stiffness.copy()
        self.held = False
        self._matrix = np.zeros((len(servos), 0)) if pull_matrix is None else np.asarray(pull_matrix)
        self._bending = np.array(bending, dtype=float)
        self._bends = np.zeros(self._matrix.shape[1])
        #: Which tendons were taut in the last balance, where the next one begins.
        self._last_taut = np.zeros(len(self._servos), dtype=bool)
        #: Matrix from wound ticks to bends by set of taut tendons.
        self._bends_by_wound: dict[bytes, NDArray[np.float64]] = {}
        for number, servo in enumerate(self._servos):
            servo.motion.load = lambda number=number: self.load_ma(number)

    @property
    def devices(self) -> tuple[int, ...]:
        """Ids of the servos."""
        return tuple(servo.device for servo in self._servos)

    def snap(self, number: int, on: bool = True) -> None:
        """Tendon ``number`` breaks, or is tied again."""
        self._stiffness[number] = 0.0 if on else self._intact_stiffness[number]
        self._bends_by_wound.clear()

    def tensions_ma(self) -> NDArray[np.float64]:
        """Tension of every tendon, 0 where it is slack [mA]."""
        position = np.array([servo.motion.position for servo in self._servos])
        wound = self._winding * (position - self._taut)
        if self.held or not self._matrix.shape[1]:
            return np.asarray(self._stiffness * np.maximum(wound, 0.0), dtype=np.float64)
        # Mostly the same tendons are taut as before.
        bends = self._by_wound(self._last_taut) @ wound
        stretch = wound - self._matrix @ bends
        if not np.array_equal(self._last_taut, (stretch > 0.0) & (self._stiffness > 0.0)):
            bends = self._balanced(wound, self._bends)
            stretch = wound - self._matrix @ bends
            self._last_taut = (stretch > 0.0) & (self._stiffness > 0.0)
        self._bends = bends
        return np.asarray(self._stiffness * np.maximum(stretch, 0.0), dtype=np.float64)

    def _balanced(self, wound: NDArray[np.float64], bends: NDArray[np.float64]) -> NDArray[np.float64]:
        """Bends of least energy by Newton's method from some bends; each step has a set of taut tendons."""
        for _ in range(_MAX_STEPS):
            stretch = wound - self._matrix @ bends
            taut = (stretch > 0.0) & (self._stiffness > 0.0)
            step = self._by_wound(taut) @ wound - bends
            share, energy = 1.0, self._energy(wound, bends)
            while self._energy(wound, bends + share * step) > energy and share > 1e-6:
                share *= 0.5
            bends = bends + share * step
            taut_after = (wound - self._matrix @ bends > 0.0) & (self._stiffness > 0.0)
            if share == 1.0 and np.array_equal(taut, taut_after):
                break
        return bends

    def _energy(self, wound: NDArray[np.float64], bends: NDArray[np.float64]) -> float:
        """Twice the elastic energy of tendons and backbone [mA tick]."""
        stretch = np.maximum(wound - self._matrix @ bends, 0.0)
        return float(self._stiffness @ stretch**2 + self._bending @ bends**2)

    def _by_wound(self, taut: NDArray[np.bool_]) -> NDArray[np.float64]:
        """The matrix that turns what is wound [ticks] into bends, while this set of tendons is taut."""
        key = taut.tobytes()
        if key not in self._bends_by_wound:
            weighted = self._matrix.T * np.where(taut, self._stiffness, 0.0)
            stiffness = weighted @ self._matrix + np.diag(self._bending)
            solved = np.linalg.solve(stiffness, weighted)
            self._bends_by_wound[key] = np.asarray(solved, dtype=np.float64)
        return self._bends_by_wound[key]

    def load_ma(self, number: int) -> float:
        """Current with which tendon ``number`` turns its servo back; its sign is that of the rotation."""
        return float(-self._winding[number] * self.tensions_ma()[number])
