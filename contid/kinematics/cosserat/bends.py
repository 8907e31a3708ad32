"""Bends of the sections of a pneumatic arm, and the pressures that have them.

A section under loads is no arc. Its bend is the angle between the tangents at its ends, towards the azimuth
of the second one in the frame at the first, and its length is that of the deformed backbone; the link after
it is rigid. Without loads these are the arc that the section is.

Pressures for bends, and lengths, are solved by Newton's method, with the updates of C. G. Broyden (Math.
Comp. 19, 1965) as long as they lead on. A length that is left open leaves one pressure of its section open:
the mean is as far above the lower limit as the pressures swing about it, so that they are the lowest with
which the bend can turn towards any azimuth at one mean.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.section import Rod

#: Pieces of a section whose lengths are added; each counts as the arc between its ends.
_PARTS: Final = 6
#: Pressure step of the differences, and greatest step of a round [bar].
_STEP_BAR: Final = 1e-4
_MOST_BAR: Final = 0.5
_ROUNDS: Final = 40
#: A step that leaves more than this share of the error.
_WORTH: Final = 0.7
#: Error at which bends [rad], lengths (by that of the section) and pressures [bar] are met.
_MET: Final = 1e-8
#: A pressure this near to its lower limit is at it [bar].
_ROUNDING_BAR: Final = 1e-7


class SectionBends:
    """Where the bends of a rod are read.

    Attributes:
        stations: reference arc lengths at which the frames of the backbone are needed [mm].
    """

    def __init__(self, rod: Rod) -> None:
        begins, begin = [], 0.0
        for section in rod.sections:
            begins.append(begin + section.length * np.arange(_PARTS + 1) / _PARTS)
            begin += section.length + section.link
        self.stations: Array = np.concatenate(begins)
        self._lengths_mm = np.array([section.length for section in rod.sections])

    def read(self, frames: Array) -> Array:
        """Components of the bends [rad] and lengths [mm], shape ``(sections, 3)``.

        Args:
            frames: position [mm] and rotation row by row at the stations, shape ``(n, 12)``.
        """
        each = frames.reshape(len(self._lengths_mm), _PARTS + 1, 12)
        tangents = each[:, :, 5::3]
        ends = np.einsum("sij,si->sj", each[:, 0, 3:].reshape(-1, 3, 3), tangents[:, -1])
        across = np.hypot(ends[:, 0], ends[:, 1])
        per_sine = np.where(
            across > 0.0, np.arctan2(across, ends[:, 2]) / np.where(across > 0.0, across, 1.0), 1.0
        )
        half_sines = 0.5 * np.linalg.norm(np.diff(tangents, axis=1), axis=2)
        chords = np.linalg.norm(np.diff(each[:, :, :3], axis=1), axis=2)
        arcs = chords * np.where(
            half_sines > 0.0, np.arcsin(half_sines) / np.where(half_sines > 0.0, half_sines, 1.0), 1.0
        )
        return np.column_stack((ends[:, :2] * per_sine[:, None], arcs.sum(axis=1)))

    def slope(self, bends_of: Callable[[Array], Array], at: Array) -> Array:
        """Derivatives of what `read` returns by pressures [bar], at some."""
        here = bends_of(at).ravel()
        moved = at + _STEP_BAR * np.eye(len(at))
        return np.column_stack([(bends_of(each).ravel() - here) / _STEP_BAR for each in moved])

    def solve(
        self,
        asked: Array,
        bends_of: Callable[[Array], Array],
        start: Sequence[float],
        lower: Sequence[float],
        slope: Array,
    ) -> Array | None:
        """Pressures [bar] that have bends and lengths ``(sections, 3)``; None where none were found.

        Args:
            asked: components of the bends [rad] and lengths [mm], 0 for an open one.
            bends_of: what `read` returns of pressures.
            start: where the search begins.
            lower: lower limits of the pressures.
            slope: derivatives of bends and lengths by pressures to begin with (`slope`).
        """
        count, least = len(start), np.asarray(lower)
        scale = np.column_stack((np.ones((len(asked), 2)), self._lengths_mm))
        free = np.flatnonzero(asked[:, 2] == 0.0)
        rows = [3 * k + 2 for k in free.tolist()]

        def error(pressures: Array) -> Array:
            found: Array = ((bends_of(pressures) - asked) / scale).ravel()
            above = (pressures - least).reshape(-1, 3)[free]
            found[rows] = above.mean(axis=1) - math.sqrt(2.0) * above.std(axis=1)
            return found

        pressures = np.array(start, dtype=np.float64)
        left = error(pressures)
        slope = slope / scale.ravel()[:, None]
        for k, row in zip(free.tolist(), rows, strict=True):
            slope[row] = 0.0
            slope[row, 3 * k : 3 * k + 3] = 1.0 / 3.0
        known = True
        for _ in range(_ROUNDS):
            if float(np.abs(left).max()) < _MET:
                return np.where(np.abs(pressures - least) < _ROUNDING_BAR, least, pressures)
            for k in range(0 if known else count):
                moved = pressures.copy()
                moved[k] += _STEP_BAR
                slope[:, k] = (error(moved) - left) / _STEP_BAR
            try:
                step = -np.linalg.solve(slope, left)
            except np.linalg.LinAlgError:
                return None
            step *= min(1.0, _MOST_BAR / max(float(np.abs(step).max()), _MET))
            pressures = pressures + step
            after = error(pressures)
            if not np.all(np.isfinite(after)):
                return None
            # Where a step does not lead far, the derivatives are computed anew.
            known = float(np.abs(after).max()) < _WORTH * float(np.abs(left).max())
            slope += np.outer(after - left - slope @ step, step) / max(float(step @ step), 1e-300)
            left = after
        return None
