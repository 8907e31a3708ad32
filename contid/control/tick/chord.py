"""One step along a straight line in space for all axes together.

A target that is further off than the axes can go in one tick is approached on a straight line: the tip on the
chord to it, its direction on the great circle, a mid-point on its own chord, all by the same share. Of the
steps that the limits allow in this tick the one is taken that leaves the line least, and of these the one
that goes as far as all axes can still brake.

    minimise  |across (J d + r)|^2 + w^2 (along (J d + r) - pace)^2    with every d allowed in this tick

r is what the linear model of the line misses. The line begins at the last command in every tick: an arm that
moves across it brakes that motion as fast as its axes can, and the line turns with it, so that the tip leaves
the chord of the jump by what it needs to turn.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from contid.control.tick.limits import AxisLimits, brake_step
from contid.kinematics.array import Array

#: From axes to where they are on the way from the last command, in the coordinates of the line.
Displacement: TypeAlias = Callable[[Array], Array]

#: Weight of progress against motion across the line, and of the preferred steps against both.
_PROGRESS: Final = 1e-3
_PREFERENCE: Final = 1e-6
#: Singular values of the line's derivative that count as none, as a share of the greatest.
_SINGULAR: Final = 1e-6
#: Steps at full speed over which the curvature ahead is taken.
_LOOK_AHEAD: Final = 8.0
#: Share of the acceleration that speeds up and brakes along the line; the rest is for its curvature.
_ALONG: Final = 0.6
_ROUNDS: Final = 3
#: Motion across the line that counts as none, as a share of what the axes can do in one tick.
_EXACT: Final = 1e-9


class StraightLine:
    """A straight line from the last command to a goal, which may drift.

    Args:
        limits: of the axes.
        J: derivative of the displacement at no step; shape ``(rows, axes)``.
        displacement: of a step, in the coordinates of the line.
        goal: displacement of the answer.
        drift: displacement of the goal per tick, in which the line moves along.
    """

    def __init__(
        self, limits: Sequence[AxisLimits], J: Array, displacement: Displacement, goal: Array, drift: Array
    ) -> None:
        self._scale = np.array([each.step for each in limits])
        self._slopes = J * self._scale
        self._size = float(np.linalg.norm(self._slopes))
        self._displacement = displacement
        self._drift = drift
        line = goal - drift
        self._length = float(np.linalg.norm(line))
        self.share = 1.0
        if self._length > _EXACT * self._size:
            self._along = line / self._length
            inverse = np.linalg.pinv(self._slopes, rcond=_SINGULAR)
            rates = inverse @ line
            part = min(1.0, _LOOK_AHEAD / max(float(np.abs(rates).max()), 1e-300))
            missed = displacement(part * rates * self._scale) - self._slopes @ (part * rates)
            self.share = _share(limits, self._scale, rates, 2.0 * (inverse @ missed) / part**2)

    def step(
        self, low: Array, high: Array, preferred: Array, halt: bool = False
    ) -> tuple[Array, float, float]:
        """The step of the axes in a tick, the share of the line it goes, and what of it is across.

        Args:
            low: least step of every axis.
            high: greatest step of every axis.
            preferred: step of which redundant axes take what does not move along or across.
            halt: brake along the line instead of going on.
        """
        scale, slopes, drift = self._scale, self._slopes, self._drift
        if not self._length > _EXACT * self._size:
            return np.clip(preferred, low, high), 1.0, 0.0
        along, count = self._along, len(scale)
        rows = np.vstack(
            [
                slopes - np.outer(along, along @ slopes),
                _PROGRESS * (along @ slopes)[None, :],
                _PREFERENCE * self._size * np.eye(count),
            ]
        )
        ends = low / scale, high / scale
        pace = 0.0 if halt else self.share * self._length
        error = np.zeros(len(drift))
        step = np.zeros(count)
        held: NDArray[np.int64] | None = None
        for _ in range(_ROUNDS):
            asked = drift - error
            progress = float(along @ asked)
            right = np.concatenate(
                [
                    asked - along * progress,
                    [_PROGRESS * (pace + progress)],
                    _PREFERENCE * self._size * preferred / scale,
                ]
            )
            step, held = _least_squares(rows, right, *ends, held)
            before, error = error, self._displacement(step * scale) - slopes @ step
            if float(np.abs(error - before).max()) <= _EXACT * self._size:
                break
        done = slopes @ step + error - drift
        progress = float(along @ done)
        across = float(np.linalg.norm(done - along * progress))
        return (
            np.clip(step * scale, low, high),
            progress / self._length,
            across / max(float(np.linalg.norm(done)), _EXACT * self._size),
        )


def _share(limits: Sequence[AxisLimits], scale: Array, rates: Array, bends: Array) -> float:
    """Greatest share of the line in one tick that the axes can brake from, at their rates and curvature.

    Args:
        limits: of the axes.
        scale: units of the axes.
        rates: change of the axes over the whole line, in these units.
        bends: second derivative of the axes along the line, whose length is 1.
    """
    braking = share = 1.0
    for each, unit, rate, bend in zip(limits, scale, np.abs(rates), np.abs(bends), strict=True):
        change = each.change / float(unit)
        if rate > 0.0:
            share = min(share, each.step / float(unit * rate))
            braking = min(braking, _ALONG * change / float(rate))
        if bend > 0.0:
            share = min(share, math.sqrt((1.0 - _ALONG) * change / float(bend)))
    return min(share, brake_step(1.0, braking))


def _least_squares(
    rows: Array, right: Array, low: Array, high: Array, held: NDArray[np.int64] | None
) -> tuple[Array, NDArray[np.int64]]:
    """Minimum of ``|rows x - right|`` with ``low <= x <= high``, and which bounds hold there (-1, 0, 1).

    Primal active set; ``held`` are the bounds of a similar problem.
    """
    count = rows.shape[1]
    bound: NDArray[np.int64] = np.zeros(count, dtype=np.int64) if held is None else held.copy()
    x = np.where(bound < 0, low, np.where(bound > 0, high, np.clip(0.0, low, high)))
    for _ in range(4 * count):
        free = bound == 0
        if free.any():
            y = x.copy()
            y[free] = np.linalg.lstsq(rows[:, free], right - rows[:, ~free] @ x[~free], rcond=None)[0]
            share, stop = 1.0, -1
            for k in np.flatnonzero((y < low) | (y > high)):
                end = low[k] if y[k] < low[k] else high[k]
                part = (end - x[k]) / (y[k] - x[k]) if y[k] != x[k] else 0.0
                if part < share:
                    share, stop = part, int(k)
            x = x + share * (y - x)
            if stop >= 0:
                bound[stop] = -1 if y[stop] < low[stop] else 1
                x[stop] = low[stop] if bound[stop] < 0 else high[stop]
                continue
        slope = rows.T @ (rows @ x - right) * bound  # positive: the bound keeps nothing
        worst = int(np.argmax(slope))
        if not slope[worst] > 1e-14 * float(np.abs(right).max() + 1e-300):
            break
        bound[worst] = 0
    return x, bound
