"""Predictions a short time ahead, with measured tips until then: the last errors of the model go on.

    e(t) = tip measured - tip predicted from commands,   e(t + s) ~ a_1 e(t) + a_2 e(t - s) + ...

This is the innovations form of a Kalman filter whose states are a disturbance of the tip (Ljung, System
Identification, 1999, section 4.3). The recursion is applied as often as the time ahead needs, to errors that
are that old at least: none between two of them, which a later tip would have been needed for. What e differs
by from its own forecast of one step is the innovation. Innovations are white, so that least squares of them
are the likelihood of what a model is asked for (`contid_identify.moved_on`), and their blocks are alike.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid_identify.split import Mask
from contid_identify.tip_motion import AheadError, MovingTip

#: Between two errors of the recursion [s], at least; for how long they are remembered [s].
STEP_S: Final = 0.01
_MEMORY_S: Final = 0.2
#: Times ahead that are judged [s].
AHEAD_S: Final = (0.03, 0.06, 0.15, 0.3)
#: Ridge of the recursion, as a share of the mean power of the errors.
_RIDGE: Final = 1e-3
#: Measured tips farther apart than this are not joined [s].
_GAP_S: Final = 0.1


@dataclass(frozen=True, eq=False)
class PredictedTips:
    """Predictions of one recording, on the equal steps of its model.

    Attributes:
        at_s: times ``(steps,)``.
        measured_m, predicted_m: tips ``(steps, 3)``; the latter from commands alone.
        inside: which steps have measured tips around them, ``(steps,)`` of bool.
        outside: share of the steps whose commands were not in the recordings of the fit.
    """

    at_s: Array
    measured_m: Array
    predicted_m: Array
    inside: Mask
    outside: float

    @property
    def errors_m(self) -> Array:
        """Of the predictions from commands alone, ``(steps, 3)``."""
        return np.asarray(self.measured_m - self.predicted_m)


def step_of(times: Sequence[Array]) -> float:
    """Between two errors of the recursion [s]: what the tips ``times`` of all recordings are apart.

    In whole multiples of `STEP_S`, so that no error has to be found between two measured ones.
    """
    apart = np.concatenate([np.diff(each) for each in times])
    return STEP_S * max(round(float(np.median(apart)) / STEP_S), 1)


def predicted_tips(
    model: MovingTip, sent: Array, period_s: float, tip_at_s: Array, tip_m: Array, load_kg: float
) -> PredictedTips:
    """Measured tips of a recording on equal steps, and predictions of them from its commands alone."""
    at_s = np.arange(float(tip_at_s[0]), float(tip_at_s[-1]), model.memory_step_s)
    measured = np.column_stack([np.interp(at_s, tip_at_s, column) for column in tip_m.T])
    after = np.clip(np.searchsorted(tip_at_s, at_s), 1, len(tip_at_s) - 1)
    inside = tip_at_s[after] - tip_at_s[after - 1] <= _GAP_S
    model = model.zeroed(sent, period_s, tip_at_s, tip_m)
    tips = model.predict(sent, period_s, at_s, load_kg)
    return PredictedTips(at_s, measured, tips, inside, model.outside(sent, period_s, at_s, load_kg))


def memory_of(errors_m: Sequence[Array], step_s: float) -> Array:
    """Weights ``(order,)`` of the recursion, of errors ``(steps, 3)`` each without gaps, ``step_s`` apart."""
    order = max(round(_MEMORY_S / step_s), 1)
    pasts, nexts = [], []
    for each in errors_m:
        if len(each) > order:
            windows = np.lib.stride_tricks.sliding_window_view(each, order + 1, axis=0)
            pasts.append(windows[..., -2::-1].reshape(-1, order))
            nexts.append(windows[..., -1].ravel())
    if not pasts:
        return np.zeros(order)
    x, y = np.concatenate(pasts), np.concatenate(nexts)
    normal = x.T @ x
    normal[np.diag_indices_from(normal)] *= 1.0 + _RIDGE
    return np.asarray(np.linalg.solve(normal, x.T @ y))


def goes_on(memory: Array, steps: int) -> Array:
    """Weights ``(order,)`` of the last errors, the newest first, for the error ``steps`` later."""
    turn = np.eye(len(memory), k=-1)
    turn[0] = memory
    return np.asarray(np.linalg.matrix_power(turn, steps)[0])


def _forecast(weights: Array, errors: Array, steps: int, inside: Mask) -> tuple[Array, Mask]:
    """Errors from those at least ``steps`` older, zero without a past; the mask of those with one."""
    order, count = len(weights), len(errors)
    out, known = np.zeros_like(errors), np.zeros(count, dtype=bool)
    for k, weight in enumerate(weights.tolist()):
        out[steps + k :] += weight * errors[: max(count - steps - k, 0)]
    first = steps + order
    window = np.convolve(~inside, np.ones(first + 1), mode="full")[:count]
    known[first:] = window[first:] == 0
    return out, known


def ahead(model: MovingTip, of: PredictedTips, ahead_s: float) -> tuple[Array, Mask]:
    """Errors of predictions ``ahead_s`` ahead, from tips that are that old or older.

    Returns:
        Errors ``(steps, 3)`` at the times of ``of``, and the mask ``(steps,)`` of those with a past.
    """
    steps = max(math.ceil(ahead_s / model.memory_step_s - 1e-6), 1)
    forecast, known = _forecast(goes_on(model.memory, steps), of.errors_m, steps, of.inside)
    return of.errors_m - forecast, known


def innovations(model: MovingTip, errors_m: Array, inside: Mask) -> Array:
    """What errors ``(steps, ...)`` differ by from their forecasts of one step; zero without a past."""
    forecast, known = _forecast(model.memory, errors_m, 1, inside)
    return np.where(known[:, None], errors_m - forecast, 0.0)


def judged_ahead(model: MovingTip, of: Sequence[tuple[PredictedTips, Mask]]) -> tuple[AheadError, ...]:
    """Errors at every time of `AHEAD_S`, then from commands alone, on the steps of a mask each.

    Raises:
        ContidError: the masks have no step, so that nothing can be judged.
    """
    if not any(rows.any() for _, rows in of):
        raise ContidError(
            f"no two measured tips within {_GAP_S:g} s of each other to judge predictions by: record with a "
            f"tracker of {1.0 / _GAP_S:g} Hz or more, for longer"
        )
    out = []
    for ahead_s in AHEAD_S:
        parts = []
        for tips, rows in of:
            errors, known = ahead(model, tips, ahead_s)
            parts.append(errors[rows & known])
        out.append(error_ahead(ahead_s, np.concatenate(parts)))
    out.append(error_ahead(float("inf"), np.concatenate([each.errors_m[rows] for each, rows in of])))
    return tuple(out)


def error_ahead(ahead_s: float, errors_m: Array) -> AheadError:
    """Size of errors ``(n, 3)``; not a number where there are none."""
    if not len(errors_m):
        return AheadError(ahead_s, float("nan"), float("nan"))
    size = np.linalg.norm(errors_m, axis=1)
    return AheadError(ahead_s, float(np.sqrt((size**2).mean())), float(np.quantile(size, 0.95)))
