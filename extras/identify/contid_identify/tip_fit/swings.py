"""The search for dead times, frequencies and damping ratios of a tip's motion."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from contid.kinematics.array import Array
from contid_identify.estimate import estimate
from contid_identify.tip_fit.tip_map import MIDDLE, ridge
from contid_identify.tip_fit.trace_rows import STIFFEST, TraceRows
from contid_identify.tip_motion import SwingHalves

#: Starts of the search: dead times [s], frequencies [Hz], damping ratio.
_DELAYS_S: Final = (0.02, 0.08, 0.2, 0.4)
_SWINGS_HZ: Final = (1.0, 2.5, 6.0)
_RATIO: Final = 0.6
_LOW: Final = (0.0, np.log(0.2), np.log(0.02))
_HIGH: Final = (2.0, np.log(30.0), np.log(3.0))
#: Bounds of softening and saturation, per `LOAD_KG`.
_LOADS: Final = ((-1.0, 0.0), (1.0, STIFFEST))
#: Play, in units of the spread of the commands, and friction: start of the search and its upper ends.
_PLAY: Final = (0.03, 0.05)
_PLAY_MOST: Final = (0.5, 0.5)
#: How far an axis may be from the others: dead time [s], logarithms of frequency and ratio.
_APART: Final = (0.03, 0.3, 0.3)
_APART_PLAY: Final = (0.05, 0.05)
#: Samples that hold as much as one alone, because errors last.
_ALIKE: Final = 25.0
#: The jackknife does not fit the map anew without each block. By this factor intervals of known plants
#: hold the truth as often as stated (`test_intervals_hold_the_truth`).
_MAP_TOO: Final = 1.6


class SettledSwings(NamedTuple):
    """Parameters of a fit, and how sure those of all axes together are."""

    parameters: Array
    halves: SwingHalves


class SwingSearch:
    """Searches by the same rows; the map behind the swings follows by ridge regression."""

    def __init__(self, given: TraceRows) -> None:
        self._given = given

    def left(self, parameters: Array, penalty: float = MIDDLE) -> Array:
        """What the map leaves over of the rows of the search ``(rows, 3)``."""
        x = self._given.columns(
            parameters, self._given.search, self._given.degree_at_most(self._given.search, 5)
        )
        tips = self._given.measured(self._given.search)
        none = np.zeros((x.shape[1], 3))
        return np.asarray(tips - x @ ridge(x.T @ x, x.T @ tips, len(x), penalty, none))

    def searched(self) -> Array:
        """Dead time, frequency and ratio common to all axes."""
        tail = [0.0, 0.1][: self._given.of_loads]
        starts = [
            np.array([delay_s, np.log(hz), np.log(_RATIO), *tail])
            for delay_s in _DELAYS_S
            for hz in _SWINGS_HZ
        ]
        return self._common(min(starts, key=lambda each: float((self.left(self._tiled(each)) ** 2).sum())))

    def with_play(self, shared: Array) -> Array:
        """The same with play and friction, from what `searched` found without: all of them change."""
        return self._common(np.concatenate([shared[:3], shared[3 * self._given.axes :], _PLAY]))

    def _tiled(self, common: Array) -> Array:
        return np.concatenate([np.tile(common[:3], self._given.axes), common[3:]])

    def _common(self, start: Array) -> Array:
        from scipy.optimize import least_squares

        low, high = self._ends_of_tail(len(start) - 3)
        start = np.concatenate([start[:3], np.clip(start[3:], low + 1e-6, high - 1e-6)])
        found = least_squares(
            lambda common: self.left(self._tiled(common)).ravel(), start,
            bounds=([*_LOW, *low], [*_HIGH, *high]), x_scale=[0.05, 0.2, 0.2, *[0.1] * len(low)],
            max_nfev=15, diff_step=1e-3,
        )  # fmt: skip
        return self._tiled(found.x)

    def _ends_of_tail(self, count: int) -> tuple[Array, Array]:
        """Least and greatest of what follows the axes: of loads, then of play and friction if any."""
        loads = self._given.of_loads
        low, high = [*_LOADS[0][:loads], 0.0, 0.0], [*_LOADS[1][:loads], *_PLAY_MOST]
        return np.array(low[:count]), np.array(high[:count])

    def refined(self, shared: Array) -> Array:
        """Every axis for itself, near the others."""
        from scipy.optimize import least_squares

        tails = len(shared) - 3 * self._given.axes
        apart = np.concatenate(
            [np.tile(_APART, self._given.axes), [*[0.3] * self._given.of_loads, *_APART_PLAY][:tails]]
        )
        ends = [
            np.concatenate([np.tile(each, self._given.axes), tail])
            for each, tail in zip((_LOW, _HIGH), self._ends_of_tail(tails), strict=True)
        ]
        size = float(np.sqrt((self.left(shared) ** 2).mean() * _ALIKE))
        if self._given.axes == 1 or size <= 0.0:
            return shared
        found = least_squares(
            lambda p: np.concatenate([self.left(p).ravel(), size * (p - shared) / apart]),
            np.clip(shared, ends[0] + 1e-6, ends[1] - 1e-6),
            bounds=ends, x_scale=apart, max_nfev=6, diff_step=1e-3,
        )  # fmt: skip
        return np.asarray(found.x)

    def settled(self, parameters: Array, penalty: float, left_out: Callable[[Array], float]) -> SettledSwings:
        """Dead times, frequencies and ratios, each moved for all axes together, by the penalty of the map.

        The search has a penalty that suits noisy data; it takes some of the swing of others. Where left-out
        folds are not predicted better by the move it is not made, and counts as not known.
        """
        axes = np.zeros((3, len(parameters)))
        for k in range(3):
            axes[k, k : 3 * self._given.axes : 3] = 1.0
        blocks = np.concatenate(
            [
                1000 * k + split.blocks[own]
                for k, (split, own) in enumerate(zip(self._given.splits, self._given.search, strict=True))
            ]
        )
        least = -min(0.05, float(parameters[: 3 * self._given.axes : 3].min()))
        found = estimate(
            lambda three: self.left(parameters + three @ axes, penalty),
            np.zeros(3), np.array([least - 1e-6, -0.2, -0.3]), np.array([0.05, 0.2, 0.3]), blocks,
        )  # fmt: skip
        half = np.array([_MAP_TOO * found.interval(*row).half for row in np.eye(3)])
        moved = parameters + found.values @ axes
        moved[: 3 * self._given.axes : 3] = np.maximum(moved[: 3 * self._given.axes : 3], 0.0)
        before, after = left_out(parameters), left_out(moved)
        if after >= before:
            moved, half = parameters, half + np.abs(found.values)
        return SettledSwings(moved, SwingHalves(*half.tolist()))
