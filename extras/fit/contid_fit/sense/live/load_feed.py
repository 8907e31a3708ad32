"""The estimated force on a tip as the load of its targets: brought in and taken out without a step.

Let k be the load that a target states, F the estimate and x what is added to k. x follows the estimate by a
first-order filter, ``x' = gain (F - k - x)``, so that it begins without a step. Without a new estimate x
holds for a while, then fades to zero as ``1 - 3u^2 + 2u^3``. An estimate that the arm could not hold 1.25
times counts as none; where it could not hold it 1.5 times (`load_observer.MARGIN`), x does not grow. Between
the two it stays: with one bound it would go to and fro, because the arm that compensates is less stable.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from contid.targets import ZERO3, Target, Vec3
from contid_fit.sense.live.symmetric import squared_distance

#: Of the filter; slower than the estimate, so that its noise does not move the arm.
GAIN_PER_S: Final = 4.0
#: Squared distance from no force, in standard deviations, that the uncertainty of an estimate explains.
UNCERTAIN: Final = 9.0
#: Time without an estimate after which the load fades, and how long that takes.
STALE_S: Final = 0.3
FADE_S: Final = 1.0


@dataclass(frozen=True, slots=True)
class CountedLoad:
    """An estimate that counts.

    Attributes:
        time_s: time of its newest measurement.
        force_n: estimated force on the tip, in the world frame.
        margin: True when the arm is stable under 1.5 times the estimate; without it ``added_n`` may not grow.
    """

    time_s: float
    force_n: Vec3
    margin: bool = True


@dataclass(frozen=True, slots=True)
class FedLoad:
    """State of one robot.

    Attributes:
        added_n: force added to the load of the targets (x above), in the world frame.
        estimate_n: newest estimate that counted, in the world frame.
        margin: `CountedLoad.margin` of that estimate.
        used_s: its time; -inf before the first.
        faded_from_n: what was added when fading began.
    """

    added_n: Vec3 = ZERO3
    estimate_n: Vec3 = ZERO3
    margin: bool = True
    used_s: float = -math.inf
    faded_from_n: Vec3 = ZERO3


def certain_share(force_n: Vec3, covariance: Sequence[float]) -> float:
    """The part of an estimate that its uncertainty leaves, 0 to 1: an arm without load is not moved by noise.

    Args:
        force_n: estimated.
        covariance: covariance of the load, row-major [N^2], shape ``(9,)``.
    """
    a, b, c, _, d, e, _, _, f = covariance
    squared = squared_distance(force_n, (a, b, c, d, e, f))
    return max(0.0, 1.0 - UNCERTAIN / squared) if squared > 0.0 else 0.0


def fed(
    before: FedLoad, now_s: float, period_s: float, estimate: CountedLoad | None, known_n: Vec3
) -> FedLoad:
    """The state after this tick.

    Args:
        before: after the previous tick.
        now_s: time of this tick.
        period_s: period of the tick.
        estimate: newest that counts; None without one.
        known_n: load of the present target, world frame.
    """
    after = before
    if estimate is not None and estimate.time_s > before.used_s:
        after = replace(before, used_s=estimate.time_s, estimate_n=estimate.force_n, margin=estimate.margin)
    if now_s - after.used_s > STALE_S:
        return _faded(after, now_s)
    share = -math.expm1(-GAIN_PER_S * period_s)
    (x, y, z), (fx, fy, fz), (kx, ky, kz) = after.added_n, after.estimate_n, known_n
    added = (x + share * (fx - kx - x), y + share * (fy - ky - y), z + share * (fz - kz - z))
    if not after.margin and math.hypot(*added) > math.hypot(x, y, z):
        added = after.added_n
    return replace(after, added_n=added, faded_from_n=added)


def loaded(state: FedLoad, target: Target) -> Target:
    """The target with the load that is added."""
    if state.added_n == ZERO3:
        return target
    (x, y, z), (kx, ky, kz) = state.added_n, target.load_n
    return replace(target, load_n=(kx + x, ky + y, kz + z))


def _faded(state: FedLoad, now_s: float) -> FedLoad:
    if state.added_n == ZERO3:
        return state
    u = (now_s - state.used_s - STALE_S) / FADE_S
    if u >= 1.0:
        return FedLoad(used_s=state.used_s)
    left = 1.0 - u * u * (3.0 - 2.0 * u)
    x, y, z = state.faded_from_n
    return replace(state, added_n=(x * left, y * left, z * left))
