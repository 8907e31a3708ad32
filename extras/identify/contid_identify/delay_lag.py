"""Stage *delay and lag*: how an axis answers its commands, from commands and measurements of that axis.

    measured(t) = offset + gain x(t),   x: the commands behind a dead time and a first-order lag (`answer`)

Three models, one after the other, each judged on blocks of time kept out: the commands themselves, commands
later by a dead time, and dead time with a lag. Where these leave much over, as behind valves, a fourth has
lags and greatest speeds of filling and venting (`filling`); it is kept where it makes the errors smaller.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid_identify.answer import CommandedTrace, answer
from contid_identify.chambers.filling import Filling, fit_filling
from contid_identify.estimate import ErrorSize, Estimate, Interval, error_of, estimate
from contid_identify.excitation import noise_of
from contid_identify.split import TimeSplit, joined_split

#: Longest dead time and lag that are searched [s].
LONGEST_DELAY_S: Final = 1.0
LONGEST_LAG_S: Final = 3.0
#: Lags and dead times of the first search, and its samples at most; the rest are left out evenly.
_LAGS: Final = 10
_DELAYS: Final = 51
_COARSE: Final = 3000
#: A fourth model is tried where three leave more than this share of the span of the commands and this many
#: times the noise, and kept where it makes the errors of the fit this much smaller.
_LEAVES: Final = 0.015
_NOISES: Final = 3.0
_BETTER: Final = 0.9
#: Measurements of one axis at least.
LEAST_SAMPLES: Final = 100


@dataclass(frozen=True, slots=True)
class JudgedStage:
    """One model and its errors, in the unit of what was measured.

    Attributes:
        name: what it adds.
        fitted, kept_out: errors on the blocks of the fit and on those kept out.
    """

    name: str
    fitted: ErrorSize
    kept_out: ErrorSize


def judged(name: str, residual: Array, split: TimeSplit) -> JudgedStage:
    """The errors of one model; ``residual`` is what it leaves over of all samples ``(samples, columns)``.

    Raises:
        ContidError: no sample is kept out, because the measurements have gaps there.
    """
    fitted, kept, pieces = split.fitted, split.kept_out, split.pieces
    if not kept.any():
        raise ContidError("its measurements have gaps where some are to be kept out: record without them")
    return JudgedStage(
        name, error_of(residual[fitted], pieces[fitted]), error_of(residual[kept], pieces[kept])
    )


@dataclass(frozen=True, eq=False)
class AxisAnswer:
    """The answer of one axis.

    Attributes:
        delay_s, lag_s: dead time and time constant.
        sum_s: their sum, which slow commands fix better than each.
        gain: of the measured values by those answered.
        stages: models and errors.
        samples: measurements of the fit, and those kept out.
        filling: of the fourth model, where it is kept.
    """

    delay_s: Interval
    lag_s: Interval
    sum_s: Interval
    gain: Interval
    stages: tuple[JudgedStage, ...]
    samples: tuple[int, int]
    filling: Filling | None = None


def fit_axis(traces: Sequence[CommandedTrace]) -> AxisAnswer:
    """Dead time and lag of one axis.

    Args:
        traces: one per recording, with ``sent`` of shape ``(ticks,)`` and ``measured`` ``(samples, 1)``.

    Raises:
        ContidError: too few measurements, or only beside gaps, or an axis that was never moved.
    """
    samples = sum(len(each.at_s) for each in traces)
    if samples < LEAST_SAMPLES:
        raise ContidError(f"{samples} measurements; at least {LEAST_SAMPLES} are needed: record longer")
    if max(float(np.ptp(each.sent)) for each in traces) <= 0.0:
        raise ContidError("it was never commanded to move; `contid excite` makes a trajectory that moves it")
    fit = _AxisFit(traces)
    still = fit.judged("as commanded", fit.fitted_to([], [], []))
    sure_s = min(each.period_s for each in traces)
    # A lag far below the period of the commands is none: what it would change is between two of them.
    least = np.log(0.02 * sure_s)
    alone_s, _ = fit.search([0.0])
    late = fit.judged("dead time", fit.fitted_to([alone_s], [0.0], [2.0 * LONGEST_DELAY_S]))
    delay_s, lag_s = fit.search(np.geomspace(0.2 * sure_s, LONGEST_LAG_S, _LAGS))
    most = [2.0 * LONGEST_DELAY_S, np.log(2.0 * LONGEST_LAG_S)]
    found = fit.fitted_to([delay_s, np.log(lag_s)], [0.0, least], most)
    both = fit.judged("dead time and lag", found)
    own = found.interval(0.0, 0.0, 0.0, 1.0).exponential()
    lag = own.value
    halves = [found.interval(0.0, 0.0, 1.0).half, own.half, found.interval(0.0, 0.0, 1.0, lag).half]
    if lag < 0.2 * sure_s:
        # Then the samples show in which period an axis moves, not when within it.
        halves = [max(half, sure_s) if np.isfinite(half) else sure_s for half in halves]
    delay = float(found.values[2])
    stages = [still, late, both]
    filling = None
    span = max(float(np.ptp(each.sent)) for each in traces)
    noise = noise_of(fit.measured)
    if lag > sure_s and both.fitted.rmse > max(_LEAVES * span, _NOISES * noise):
        filling = fit_filling(traces, fit.split, delay)
        fourth = judged("filling and venting", filling.residual, fit.split)
        if fourth.fitted.rmse < _BETTER * both.fitted.rmse:
            stages.append(fourth)
        else:
            filling = None
    return AxisAnswer(
        Interval(delay, halves[0]),
        Interval(lag, halves[1]),
        Interval(delay + lag, halves[2]),
        found.interval(0.0, 1.0),
        tuple(stages),
        (int(fit.split.fitted.sum()), int(fit.split.kept_out.sum())),
        filling,
    )


def _predicted(traces: Sequence[CommandedTrace], delay_s: float, lag_s: float) -> Array:
    return np.concatenate([answer(each.sent, each.period_s, each.at_s, delay_s, lag_s) for each in traces])


class _AxisFit:
    """Fits of one axis to the same traces."""

    def __init__(self, traces: Sequence[CommandedTrace]) -> None:
        self.traces = traces
        self.split: TimeSplit = joined_split([each.at_s for each in traces])
        self.measured = np.concatenate([each.measured[:, 0] for each in traces])

    def residual(self, parameters: Array) -> Array:
        """Of offset, gain, then dead time and logarithm of the lag where there are any; all samples."""
        offset, gain, *rest = parameters.tolist()
        delay_s = rest[0] if rest else 0.0
        lag_s = float(np.exp(rest[1])) if len(rest) > 1 else 0.0
        return np.asarray((self.measured - offset - gain * _predicted(self.traces, delay_s, lag_s))[:, None])

    def search(self, lags_s: Sequence[float] | Array) -> tuple[float, float]:
        """The best dead time and lag of a grid; offset and gain by linear regression."""
        thin = max(len(self.measured) // _COARSE, 1)
        few = [each.picked(np.arange(0, len(each.at_s), thin)) for each in self.traces]
        rows = joined_split([each.at_s for each in few]).fitted
        measured = np.concatenate([each.measured[:, 0] for each in few])[rows]
        measured = measured - measured.mean()
        best = (np.inf, 0.0, 0.0)
        for lag_s in lags_s:
            delays = np.linspace(0.0, LONGEST_DELAY_S, _DELAYS)
            for _ in range(2):  # a second time around the best of the first
                for delay_s in delays:
                    x = _predicted(few, float(delay_s), float(lag_s))[rows]
                    x = x - x.mean()
                    power = float(x @ x)
                    left = float(measured @ measured) - (
                        float(x @ measured) ** 2 / power if power > 0.0 else 0.0
                    )
                    best = min(best, (left, float(delay_s), float(lag_s)))
                step = LONGEST_DELAY_S / (_DELAYS - 1)
                delays = np.clip(best[1] + np.linspace(-step, step, 21), 0.0, None)
        return best[1], best[2]

    def fitted_to(self, start: Sequence[float], low: Sequence[float], high: Sequence[float]) -> Estimate:
        """Least squares from a start of what follows offset and gain."""
        delay_s = start[0] if start else 0.0
        lag_s = float(np.exp(start[1])) if len(start) > 1 else 0.0
        rows = self.split.fitted
        x, y = _predicted(self.traces, delay_s, lag_s)[rows], self.measured[rows]
        gain = float(np.cov(x, y)[0, 1] / max(float(np.var(x, ddof=1)), 1e-300))
        line = [float(y.mean() - gain * x.mean()), gain]
        return estimate(
            lambda p: self.residual(p)[rows],
            np.array([*line, *start]),
            np.array([-np.inf, -np.inf, *low]),
            np.array([np.inf, np.inf, *high]),
            self.split.blocks[rows],
        )

    def judged(self, name: str, found: Estimate) -> JudgedStage:
        """The errors of a fit."""
        return judged(name, self.residual(found.values), self.split)
