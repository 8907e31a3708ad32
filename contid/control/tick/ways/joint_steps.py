"""Steps of all axes of a robot in one tick: at rest, braking together, and whether they can be stopped.

A step is the difference of two consecutive commands, in m, Pa or rad; `AxisLimits` has the greatest of every
axis, and the greatest change of it. Axes that stop together brake on a straight line: the one that takes
longest by its greatest change, the others by the same share.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from contid.control.tick.config import RobotConfig
from contid.control.tick.limits import AxisLimits
from contid.kinematics.array import Array
from contid.targets import Actuation, Target

#: A step below this share of the greatest change of a step counts as rest.
_REST: Final = 1e-2
#: Differences of axes that are rounding, as a share of a step.
ROUNDING: Final = 1e-6


def within(config: RobotConfig, own: Actuation, extra: Actuation) -> bool:
    """True when the limits of the model, such as a bend radius, allow its axes these values."""
    kept = config.model.inverse(Target(actuation=own), (*own, *extra)).actuation
    axes = zip(kept, own, config.limits, strict=False)
    return max(abs(a - b) / each.step for a, b, each in axes) <= ROUNDING


def stop_ratio(limits: Sequence[AxisLimits], step: Array) -> float:
    """How many times its length the axes go if they stop together after a step, n + ... + 1 for n."""
    return max(1.0, 0.5 * (_ticks_to_stop(limits, step) + 1.0))


def braked(limits: Sequence[AxisLimits], last_steps: Array, low: Array, high: Array) -> Array:
    """Steps of axes that stop together as fast as they can, an axis near its end by itself."""
    ticks = _ticks_to_stop(limits, last_steps)
    step: Array = np.clip(last_steps * (max(0.0, 1.0 - 1.0 / ticks) if ticks > 0.0 else 0.0), low, high)
    return step


def _ticks_to_stop(limits: Sequence[AxisLimits], steps: Array) -> float:
    ticks: float = max(abs(d) / each.change for d, each in zip(steps.tolist(), limits, strict=True))
    return ticks


def stands(limits: Sequence[AxisLimits], steps: Array) -> bool:
    """True for steps that change nothing."""
    return all(abs(d) <= _REST * each.change for d, each in zip(steps.tolist(), limits, strict=True))


def feasible_part(paces: Array, low: Array, high: Array) -> float:
    """The greatest part of the axes' paces that they may take in this tick: one at rest has to speed up."""
    part = 1.0
    for pace, least, greatest in zip(paces.tolist(), low.tolist(), high.tolist(), strict=True):
        if pace:
            room = max(greatest, 0.0) if pace > 0.0 else min(least, 0.0)
            part = min(part, room / pace)
    return part


def unbounded_steps(limits: Sequence[AxisLimits], last_steps: Array) -> tuple[Array, Array]:
    """Least and greatest steps by speed and acceleration alone."""
    step, change = (np.array(side) for side in zip(*((e.step, e.change) for e in limits), strict=True))
    return np.clip(last_steps - change, -step, step), np.clip(last_steps + change, -step, step)
