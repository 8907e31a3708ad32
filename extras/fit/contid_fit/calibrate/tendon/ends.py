"""The capstan coefficient from load cells at both ends of tendons, while they slide.

A tendon that is pulled in slides towards its motor, one that is paid out away from it:

    ln(far / near) = g - mu Theta,  pulled in;      ln(far / near) = g + mu Theta,  paid out,

near and far the tensions at motor and body, Theta the angle that the tendon turns by in the bends it passes
(Euler and Eytelwein). g takes cells that are not calibrated to each other, a constant per tendon. After a
reversal a tendon sticks before it slides back: only the second half of each way is used.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.kinematics.array import Array

#: Part of each way that is left out, and ways that are enough for an interval.
_STICKS: Final = 0.5
_WAYS: Final = 4
#: Half of the interval of 95 %, in standard deviations of a jackknife over ways.
_HALF: Final = 2.0


@dataclass(frozen=True, slots=True)
class CapstanCoefficient:
    """mu with its 95 % interval."""

    value: float
    low: float
    high: float


def capstan_from_ends(
    turned_rad: Array, pull_m: Array, ends_n: Array, runs: Array
) -> CapstanCoefficient | None:
    """Mu with its interval; None without two tensions, with too few ways, or in one direction only.

    Args:
        turned_rad: by how much each tendon turns, shape ``(rows, tendons)``.
        pull_m: of each tendon, positive when it is pulled in, the same shape.
        ends_n: tension of each tendon at motor and body, ``(rows, tendons, 2)``; NaN where there is no cell.
        runs: number of the run of each row, ``(rows,)``; nothing slides from one to the next.
    """
    ways = [
        way
        for tendon in range(pull_m.shape[1])
        for way in _ways(turned_rad[:, tendon], pull_m[:, tendon], ends_n[:, tendon], runs, tendon)
    ]
    if len(ways) < _WAYS:
        return None
    owner = np.repeat(np.arange(len(ways)), [len(way) for way in ways])
    rows = np.concatenate(ways)
    value = _slope(rows)
    left_out = np.array([_slope(rows[owner != one]) for one in range(len(ways))])
    if not np.isfinite(value) or not np.all(np.isfinite(left_out)):
        return None
    spread = np.sqrt((len(ways) - 1) * np.mean((left_out - left_out.mean()) ** 2))
    return CapstanCoefficient(value, value - _HALF * float(spread), value + _HALF * float(spread))


def _ways(turned: Array, pull: Array, ends: Array, runs: Array, tendon: int) -> list[Array]:
    """Rows (tendon, signed angle, ln(far / near)) of the second half of each way in one direction."""
    step = np.diff(pull)
    side = np.sign(step) * (runs[1:] == runs[:-1])
    begins = np.flatnonzero(np.concatenate(([True], side[1:] != side[:-1])))
    found = []
    for first, last in zip(begins, [*begins[1:], len(side)], strict=True):
        row = np.arange(first, last) + 1
        near, far = ends[row].T
        gone = np.abs(pull[row] - pull[first])
        slides = (gone > _STICKS * gone[-1]) & (np.fmin(near, far) > 0.0)
        if side[first] and np.any(slides):
            log = np.log(far[slides] / near[slides])
            signed = -side[first] * turned[row][slides]
            found.append(np.stack((np.full(len(log), float(tendon)), signed, log), axis=1))
    return found


def _slope(rows: Array) -> float:
    """Least squares of one slope, with a constant per tendon; NaN where every angle has one sign."""
    angle, log = rows[:, 1].copy(), rows[:, 2].copy()
    both = False
    for tendon in np.unique(rows[:, 0]):
        own = rows[:, 0] == tendon
        both |= bool(angle[own].min() < 0.0 < angle[own].max())
        angle[own] -= angle[own].mean()
        log[own] -= log[own].mean()
    return float(angle @ log / (angle @ angle)) if both else float("nan")
