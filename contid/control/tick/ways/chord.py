"""One step along a straight line in space for all axes together.

A target that is further off than the axes can go in one tick is approached on a straight line: the tip on the
chord to it, its direction on the great circle, a mid-point on its own chord, all by the same share. Of the
steps that the limits allow in this tick the one is taken that leaves the line least, and of these the one
that goes as far as all axes can still brake.

    minimise  |across (J d + r)|^2 + w^2 (along (J d + r) - pace)^2    with every d allowed in this tick

r is what the linear model of the line misses; ``contid/kernels/limiter/chord.hpp`` finds the least. The line
begins at the last command in every tick: an arm that moves across it brakes that motion as fast as its axes
can, and the line turns with it, so that the tip leaves the chord of the jump by what it needs to turn.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final, TypeAlias

import numpy as np

from contid.control.tick.limits import AxisLimits, brake_step, kernel
from contid.kinematics.array import Array, pseudo_inverse, size_of

#: From axes to where they are on the way from the last command, in the coordinates of the line.
Displacement: TypeAlias = Callable[[Array], Array]

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
        self._size = size_of(self._slopes)
        self._displacement = displacement
        self._drift = drift
        line = goal - drift
        self._length = size_of(line)
        self.share = 1.0
        if self._length > _EXACT * self._size:
            self._along = line / self._length
            inverse = pseudo_inverse(self._slopes, _SINGULAR)
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
        preferred = preferred / scale
        ends = low / scale, high / scale
        pace = 0.0 if halt else self.share * self._length
        error = np.zeros(len(drift))
        step = np.empty(count)
        held = np.zeros(count, dtype=np.int8)
        nearest = kernel().nearest_step
        for _ in range(_ROUNDS):
            nearest(slopes, along, self._size, drift - error, pace, preferred, *ends, held, step)
            before, error = error, self._displacement(step * scale) - slopes @ step
            if float(np.abs(error - before).max()) <= _EXACT * self._size:
                break
        done = slopes @ step + error - drift
        progress = float(along @ done)
        across = size_of(done - along * progress)
        return (
            np.clip(step * scale, low, high),
            progress / self._length,
            across / max(size_of(done), _EXACT * self._size),
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
