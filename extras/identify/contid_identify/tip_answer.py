"""Stage *tip*: when and how the tip answers commands, with a static map that the data themselves give.

    tip(t) = sum_j w_j y_j(t),   y_j: a monomial of the commands, late, behind a lag and a swing

(Hammerstein: the map first, one linear answer for all behind it). The statics of the robot's model, where it
has one, is among the inputs; then monomials are of first degree and correct it. The weights follow by linear
regression for every dead time, lag, frequency and damping that is tried (variable projection, Golub and
Pereyra 1973). The map holds in the range of the recording only and is not written anywhere.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Final

import numpy as np

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid_identify.answer import CommandedTrace, between, first_order
from contid_identify.delay_lag import JudgedStage, judged
from contid_identify.estimate import Estimate, Interval, estimate
from contid_identify.split import joined_split

#: Share of the variance of the commands below which a combination of axes counts as not moved.
_STILL: Final = 1e-4
#: Degrees of the monomials; the first one with this number of measurements per monomial is taken, else 1.
_DEGREES: Final = (3, 2, 1)
_PER_MONOMIAL: Final = 60
#: Ridge of the regression, as a share of the mean power of the monomials; what never occurs stays 0.
_RIDGE: Final = 1e-6
LEAST_TIPS: Final = 200
#: Places of the parameters. Those from `_LAG` on are logarithms: half of their interval is a relative error.
_DELAY, _LAG, _FREQUENCY, _RATIO = range(4)
#: Starts of the dead time without a lag.
_DELAYS_S: Final = (0.02, 0.08, 0.2, 0.4)
#: Starts with a lag: this share of that dead time stays dead time, the rest is the lag, at least this one.
_STAYS_DELAY: Final = (0.3, 0.8)
_LEAST_LAG_S: Final = 0.01
#: Starts with a swing: this share of the dead time, the lag up to this one, these frequencies, this ratio.
_SWING_DELAY: Final = 0.5
_SWING_LAG_S: Final = 0.1
_SWINGS_HZ: Final = (1.0, 2.5, 6.0)
_SWING_RATIO: Final = 0.2
#: A swing is shown below this damping ratio, at which the overshoot after a step is 0.15 %, when half of the
#: interval of its frequency is below this share of it, and when the errors kept out are smaller with it.
_SHOWN_RATIO: Final = 0.9
_SHOWN_ERROR: Final = 0.3


@dataclass(frozen=True, eq=False)
class TipAnswer:
    """The answer of a tip.

    Attributes:
        delay_s, lag_s: dead time and lag from commands to the tip, without the swing.
        frequency_hz, ratio: damped frequency and damping ratio of the swing; None where it is not shown.
        stages: models and errors [m].
        degree: of the monomials.
    """

    delay_s: Interval
    lag_s: Interval
    frequency_hz: Interval | None
    ratio: Interval | None
    stages: tuple[JudgedStage, ...]
    degree: int


def fit_tip(traces: Sequence[CommandedTrace], statics_m: Sequence[Array] | None = None) -> TipAnswer:
    """Dead time, lag and swing of a tip.

    Args:
        traces: one per recording, ``sent`` ``(ticks, axes)`` and ``measured`` ``(samples, 3)`` [m].
        statics_m: tips of the commands by a model, one array ``(ticks, 3)`` per recording.

    Raises:
        ContidError: too few tips, or no axis moved.
    """
    count = sum(len(each.at_s) for each in traces)
    if count < LEAST_TIPS:
        raise ContidError(f"{count} measured tips; at least {LEAST_TIPS} are needed")
    fit = _TipFit(traces, statics_m)
    static = fit.judged("static map", fit.fitted([]))
    late = fit.best([[delay_s] for delay_s in _DELAYS_S])
    stages = [static, fit.judged("dead time", late)]
    alone_s = float(late.values[_DELAY])
    lagged = fit.best(
        [[share * alone_s, np.log(max((1.0 - share) * alone_s, _LEAST_LAG_S))] for share in _STAYS_DELAY]
    )
    stages.append(fit.judged("dead time and lag", lagged))
    delay_s, log_lag = lagged.values.tolist()
    begin = [_SWING_DELAY * delay_s, min(log_lag, np.log(_SWING_LAG_S))]
    swung = fit.best([[*begin, np.log(hz), np.log(_SWING_RATIO)] for hz in _SWINGS_HZ])
    stages.append(fit.judged("and swing", swung))
    ratio = float(np.exp(swung.values[_RATIO]))
    relative_error = _parameter(swung, _FREQUENCY).half
    better = stages[3].kept_out.rmse < stages[2].kept_out.rmse
    shown = ratio < _SHOWN_RATIO and relative_error < _SHOWN_ERROR and better
    found = swung if shown else lagged
    frequency = damping = None
    if shown:
        damped_hz = float(np.exp(swung.values[_FREQUENCY])) * np.sqrt(1.0 - ratio**2)
        frequency = Interval(damped_hz, damped_hz * relative_error)
        damping = _parameter(swung, _RATIO).exponential()
    return TipAnswer(
        delay_s=_parameter(found, _DELAY),
        lag_s=_parameter(found, _LAG).exponential(),
        frequency_hz=frequency,
        ratio=damping,
        stages=tuple(stages),
        degree=fit.degree,
    )


def _parameter(found: Estimate, place: int) -> Interval:
    """One parameter of a fit, as the sum in which it alone has a weight."""
    return found.interval(*[0.0] * place, 1.0)


class _TipFit:
    """Fits of the same traces. Parameters: dead time, logarithms of lag, undamped frequency and ratio."""

    _LOW: Final = (0.0, np.log(1e-4), np.log(0.2), np.log(0.01))
    _HIGH: Final = (2.0, np.log(6.0), np.log(30.0), np.log(2.0))

    def __init__(self, traces: Sequence[CommandedTrace], statics_m: Sequence[Array] | None) -> None:
        self.traces = traces
        self.split = joined_split([each.at_s for each in traces])
        self.measured = np.concatenate([each.measured for each in traces])
        sent = np.concatenate([each.sent for each in traces])
        middle = sent.mean(axis=0)
        # Rows of `principal` are the principal directions of the commands.
        _, sizes, principal = np.linalg.svd(sent - middle, full_matrices=False)
        moved = sizes**2 > _STILL * max(float((sizes**2).sum()), 1e-300)
        if not moved.any() or sizes[0] <= 0.0:
            raise ContidError(
                "no axis was commanded to move; `contid excite` makes a trajectory that moves it"
            )
        scale = np.abs((sent - middle) @ principal[moved].T).max(axis=0)
        combinations = int(moved.sum())
        rows = int(self.split.fitted.sum())
        degrees = _DEGREES if statics_m is None else (1,)
        # Monomials of n factors up to degree d without the constant: n + d over d, less one.
        self.degree = next(
            (d for d in degrees if rows >= _PER_MONOMIAL * (math.comb(combinations + d, d) - 1)), 1
        )
        self.inputs = []
        tips = self.measured
        for k, each in enumerate(traces):
            parts = (each.sent - middle) @ principal[moved].T / scale
            columns = [np.ones(len(parts)), monomials(parts, self.degree)]
            if statics_m is not None:
                columns.append((statics_m[k] - tips.mean(axis=0)) / max(float(np.ptp(tips)), 1e-9))
            self.inputs.append(np.column_stack(columns))

    def outputs(self, parameters: Array) -> Array:
        """What the weights act on, at the times of all measurements ``(samples, monomials)``."""
        found = []
        for trace, inputs in zip(self.traces, self.inputs, strict=True):
            values = inputs
            if len(parameters) > 1:
                values = first_order(values, trace.period_s, float(np.exp(parameters[1])))
            if len(parameters) > 2:
                hz, ratio = np.exp(parameters[2:4])
                values = swing(values, trace.period_s, float(hz), float(ratio))
            delay_s = float(parameters[0]) if len(parameters) else 0.0
            found.append(between(values, (trace.at_s - delay_s) / trace.period_s))
        return np.concatenate(found)

    def residual(self, parameters: Array) -> Array:
        """What the best weights of the fitted blocks leave over, all samples ``(samples, 3)``."""
        outputs = self.outputs(parameters)
        rows = self.split.fitted
        x = outputs[rows]
        normal = x.T @ x
        normal[np.diag_indices_from(normal)] += _RIDGE * float(np.trace(normal)) / len(normal)
        weights = np.linalg.solve(normal, x.T @ self.measured[rows])
        return np.asarray(self.measured - outputs @ weights)

    def best(self, starts: Sequence[Sequence[float]]) -> Estimate:
        """The least squares that begins at the best of some starts."""
        rows = self.split.fitted
        return self.fitted(
            min(starts, key=lambda start: float((self.residual(np.array(start))[rows] ** 2).sum()))
        )

    def fitted(self, start: Sequence[float]) -> Estimate:
        """Least squares from a start."""
        rows, count = self.split.fitted, len(start)
        blocks = self.split.blocks[rows]
        if not count:
            return Estimate(np.zeros(0), np.zeros((0, 0)), 0.0, self.residual(np.zeros(0))[rows])
        return estimate(
            lambda p: self.residual(p)[rows],
            np.array(start), np.array(self._LOW[:count]), np.array(self._HIGH[:count]), blocks,
        )  # fmt: skip

    def judged(self, name: str, found: Estimate) -> JudgedStage:
        """The errors of a fit [m]."""
        return judged(name, self.residual(found.values), self.split)


def monomials(values: Array, degree: int) -> Array:
    """Products of up to ``degree`` columns of ``(n, columns)``, without the constant: ``(n, monomials)``."""
    columns = range(values.shape[1])
    chosen = (c for power in range(1, degree + 1) for c in combinations_with_replacement(columns, power))
    rows = np.ascontiguousarray(values.T)
    found: dict[tuple[int, ...], Array] = {}
    for each in chosen:
        found[each] = found[each[:-1]] * rows[each[-1]] if len(each) > 1 else rows[each[0]]
    return np.stack(list(found.values())).T


def swing(values: Array, period_s: float, frequency_hz: float, ratio: float) -> Array:
    """A body of one mode behind values ``(ticks, columns)`` that hold from tick to tick; gain 1.

        x'' + 2 ratio rate x' + rate^2 x = rate^2 u

    has the poles s1 and s2, and from rest the answer to a step of u from 0 to 1

        x(t) = 1 - (s2 exp(s1 t) - s1 exp(s2 t)) / (s2 - s1)

    The filter has the poles a = exp(s1 period) and b = exp(s2 period), so its denominator is
    1 - (a + b) / z + a b / z^2. The first coefficient of its numerator is x(period); the second follows from
    gain 1 at z = 1.
    """
    from scipy.signal import lfilter

    rate = 2.0 * np.pi * frequency_hz
    # The formula divides by s2 - s1: two equal poles are replaced by two that hardly differ.
    ratio = ratio if abs(ratio - 1.0) > 1e-7 else 1.0 + 1e-7
    apart = rate * np.sqrt(complex(ratio**2 - 1.0))
    first_pole, second_pole = -ratio * rate + apart, -ratio * rate - apart
    a, b = np.exp(first_pole * period_s), np.exp(second_pole * period_s)
    after_one = (1.0 - (second_pole * a - first_pole * b) / (second_pole - first_pole)).real
    both, product = (a + b).real, (a * b).real
    first = values[:1]
    numerator = [0.0, after_one, 1.0 - both + product - after_one]
    return np.asarray(first + lfilter(numerator, [1.0, -both, product], values - first, axis=0))
