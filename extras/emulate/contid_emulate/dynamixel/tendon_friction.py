"""Tendons with friction on the spools of emulated servos: backlash, and stick and slip in the bends.

Formulated apart from the lead of the control loop. A pin in a slot is the backlash between spool and
tendon. Each section is `PIECES` pieces of bend; in each piece a tendon of tension T hangs on a bristle that
carries up to ``mu T`` per radian and slips beyond (Dahl's model with a sharp corner: P. Dahl, Aerospace
TOR-158, 1968),

    T_after - T_before = -mu (theta / PIECES) sigma (T_before + T_after) / 2,
    sigma = clip(sigma before + sliding / BRISTLE, -1, 1),

and the bends are where the moments of all pieces balance the backbone, found step by step by Newton's method.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from contid_emulate.dynamixel.servo import Servo
from contid_emulate.dynamixel.tendons import TendonPlant

Floats = NDArray[np.float64]

PIECES: Final = 4
#: Sliding from rest to slip [ticks].
BRISTLE: Final = 0.3
#: Change of what is wound that is solved in one step, and that is not solved anew [ticks].
_STEP: Final = 20.0
_SAME: Final = 0.1
_ITERATIONS: Final = 40
#: The load on a shaft is solved anew after this time of the servos: they step one after the other, thousands
#: of times a second.
_EVERY_S: Final = 0.01
_SMALL: Final = 1e-7


class FrictionPlant(TendonPlant):
    """A `TendonPlant` whose tendons rub.

    Args:
        servos, winding, taut_ticks, ma_per_tick, pull_matrix: as of `TendonPlant`.
        bending: the same, two per section.
        backlash_ticks: half width of the backlash of each tendon.
        capstan: mu of each section.
    """

    def __init__(
        self,
        servos: Sequence[Servo],
        winding: Sequence[int],
        taut_ticks: Sequence[float],
        ma_per_tick: Sequence[float],
        pull_matrix: Floats,
        bending: Sequence[float],
        *,
        backlash_ticks: Sequence[float],
        capstan: Sequence[float],
    ) -> None:
        super().__init__(servos, winding, taut_ticks, ma_per_tick, pull_matrix, bending)
        tendons, count = len(servos), len(bending) // 2
        self._backlash = np.array(backlash_ticks, dtype=float)
        self._mu = np.array(capstan, dtype=float)
        self._arms = self._matrix.reshape(tendons, count, 2)
        self._passes = np.any(self._arms != 0.0, axis=2)
        self._slid = _sliding(self._arms)
        self._sigma = np.zeros((tendons, count, PIECES))
        self._at: Floats | None = None
        self._arrived = np.zeros(tendons)
        self._tensions = np.zeros(tendons)
        self._solved_s = -math.inf

    @property
    def bends(self) -> Floats:
        """Bends of the backbone, x and y of each section [rad]."""
        self.tensions_ma()
        return np.array(self._bends)

    def tensions_ma(self) -> Floats:
        """Tension of every tendon at its spool, 0 where it is slack [mA]."""
        if self.held:
            self._at = None
            return super().tensions_ma()
        position = np.array([servo.motion.position for servo in self._servos])
        wound = self._winding * (position - self._taut)
        if self._at is None:  # out of the tube: nothing has slid yet
            self._at, self._arrived = wound, wound
            self._sigma[:] = 0.0
            self._bends = np.zeros(len(self._bending))
            self._solve(wound)
        if float(np.abs(wound - self._at).max()) > _SAME:
            parts = math.ceil(float(np.abs(wound - self._at).max()) / _STEP)
            for part in range(1, parts + 1):
                here = self._at + (wound - self._at) * part / parts
                self._arrived = np.minimum(
                    here + self._backlash, np.maximum(here - self._backlash, self._arrived)
                )
                self._solve(self._arrived)
            self._at = wound
        return self._tensions

    def load_ma(self, number: int) -> float:
        """Current with which tendon ``number`` turns its servo back; its sign is that of the rotation.

        See `TendonPlant`; from the last balance while that is young.
        """
        if self.held:
            return super().load_ma(number)
        now_s = self._servos[number].now
        if self._at is None or now_s - self._solved_s > _EVERY_S:
            self._solved_s = now_s
            self.tensions_ma()
        return float(-self._winding[number] * self._tensions[number])

    def snap(self, number: int, on: bool = True) -> None:
        """Tendon ``number`` breaks, or is tied again."""
        super().snap(number, on)
        if self._at is not None:
            self._solve(self._arrived)

    def _solve(self, wound: Floats) -> None:
        """The next bends from the last ones."""
        last, bends = self._bends, np.array(self._bends)
        steps = np.vstack((np.zeros(len(bends)), 1e-6 * np.eye(len(bends))))
        for _ in range(_ITERATIONS):
            left = self._left(wound, bends + steps, last)
            jacobian = (left[1:] - left[0]).T / 1e-6
            step = np.linalg.lstsq(jacobian, left[0], rcond=None)[0]
            shares = 0.5 ** np.arange(10)
            trials = bends - shares[:, None] * step
            sizes = np.abs(self._left(wound, trials, last)).max(axis=1)
            best = int(np.argmin(sizes))
            bends = trials[best]
            if float(np.abs(step).max()) * shares[best] < _SMALL:
                break
        self._sigma = self._sense(bends[None], last)[0]
        self._bends = bends
        self._tensions = self._stiffness * np.maximum(wound - self._matrix @ bends, 0.0)

    def _sense(self, bends: Floats, last: Floats) -> Floats:
        slid = np.einsum("ikpm,bm->bikp", self._slid, bends - last)
        return np.asarray(np.clip(self._sigma + slid / BRISTLE, -1.0, 1.0))

    def _left(self, wound: Floats, bends: Floats, last: Floats) -> Floats:
        """Moments out of balance of rows of bends."""
        rows, (tendons, count, _) = len(bends), self._arms.shape
        spool = self._stiffness * np.maximum(wound - bends @ self._matrix.T, 0.0)
        turned = self._mu * np.hypot(bends[:, 0::2], bends[:, 1::2]) / (2.0 * PIECES)
        rub = self._sense(bends, last) * (turned[:, None, :] * self._passes)[..., None]
        after = np.cumprod(((1.0 - rub) / (1.0 + rub)).reshape(rows, tendons, count * PIECES), axis=2)
        before = np.concatenate((np.ones((rows, tendons, 1)), after[:, :, :-1]), axis=2)
        mean = (before.reshape(rub.shape) / (1.0 + rub)).mean(axis=3)
        moments = np.einsum("bi,bik,ikc->bkc", spool, mean, self._arms)
        return np.asarray(bends * self._bending - moments.reshape(rows, 2 * count))


def _sliding(arms: Floats) -> Floats:
    """What a tendon slides in each piece by bends, ``(tendons, sections, pieces, 2 sections)``."""
    tendons, count, _ = arms.shape
    out = np.zeros((tendons, count, PIECES, count, 2))
    for k in range(count):
        out[:, k, :, k + 1 :] = arms[:, None, k + 1 :]
        beyond = 1.0 - (np.arange(PIECES) + 0.5) / PIECES  # of the section's own bend
        out[:, k, :, k] = beyond[None, :, None] * arms[:, None, k]
    return out.reshape(tendons, count, PIECES, 2 * count)
