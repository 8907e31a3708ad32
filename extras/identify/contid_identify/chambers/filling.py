"""A chamber behind a regulator: filling and venting differ, and neither is faster than the valve lets it.

    x' = clip((u(t - d) - x) / tau, -v, f),   tau = t_f where x rises, t_v where it falls

Six numbers: dead time, two lags, the fastest filling f and venting v, and where it begins. Gain and offset
follow by linear regression. It is a stage of an axis behind *dead time and lag* (`delay_lag`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.kinematics.array import Array
from contid_identify.answer import CommandedTrace
from contid_identify.estimate import Interval, estimate
from contid_identify.split import TimeSplit

#: Steps of the simulation [s] at most.
_STEP_S: Final = 0.02
#: Lags [s]; fastest filling and venting, in spans of the commands per second.
_LAGS_S: Final = (0.01, 5.0)
_FASTEST: Final = (0.02, 50.0)
#: Starts: both lags [s], fastest motion [spans/s].
_STARTS: Final = ((0.8, 20.0), (0.4, 0.6), (0.15, 2.0))


@dataclass(frozen=True, eq=False)
class Filling:
    """How a chamber fills and vents.

    Attributes:
        delay_s: dead time.
        fill_lag_s, vent_lag_s: time constants.
        fill_per_s, vent_per_s: fastest motion, in the unit of the axis.
        residual: what is left of all samples ``(samples, 1)``.
    """

    delay_s: Interval
    fill_lag_s: Interval
    vent_lag_s: Interval
    fill_per_s: Interval
    vent_per_s: Interval
    residual: Array


def filled(sent: Array, period_s: float, at_s: Array, numbers: Sequence[float]) -> Array:
    """The chamber at times ``at_s``.

    Args:
        sent: commands ``(ticks,)``, held from tick to tick.
        period_s: between two of them.
        at_s: times ``(samples,)``.
        numbers: dead time [s], lags of filling and venting [s], fastest filling and venting per second, and
            the value at the start.
    """
    delay_s, fill_s, vent_s, fastest, slowest, x = map(float, numbers)
    per_tick = max(math.ceil(period_s / _STEP_S), 1)
    step_s = period_s / per_tick
    up, down = 1.0 - math.exp(-step_s / fill_s), 1.0 - math.exp(-step_s / vent_s)
    most, least = fastest * step_s, -slowest * step_s
    out = []
    for target in np.repeat(sent, per_tick).tolist():
        out.append(x)
        gap = target - x
        x += min(gap * up, most) if gap > 0.0 else max(gap * down, least)
    return np.interp((at_s - delay_s) / step_s, np.arange(len(out)), out)


def fit_filling(traces: Sequence[CommandedTrace], split: TimeSplit, delay_s: float) -> Filling:
    """The chamber of one axis.

    Args:
        traces: one per recording, ``sent`` ``(ticks,)`` and ``measured`` ``(samples, 1)``.
        split: of the samples of all traces.
        delay_s: dead time to begin with.
    """
    measured = np.concatenate([each.measured[:, 0] for each in traces])
    rows = split.fitted
    span = max(float(np.ptp(each.sent)) for each in traces)

    def predicted(parameters: Array) -> Array:
        shared = [float(parameters[0]), *np.exp(parameters[1:3]), *(span * np.exp(parameters[3:5]))]
        return np.concatenate(
            [
                filled(each.sent, each.period_s, each.at_s, [*shared, each.sent[0] + span * begin])
                for each, begin in zip(traces, parameters[5:].tolist(), strict=True)
            ]
        )

    def left(parameters: Array) -> Array:
        x = np.column_stack([np.ones(len(measured)), predicted(parameters)])
        line = np.linalg.lstsq(x[rows], measured[rows], rcond=None)[0]
        return np.asarray((measured - x @ line)[:, None])

    def start_of(lag_s: float, fastest: float) -> Array:
        return np.array([delay_s, *np.log([lag_s, lag_s, fastest, fastest]), *[0.0] * len(traces)])

    start = min((start_of(*each) for each in _STARTS), key=lambda each: float((left(each)[rows] ** 2).sum()))
    ends = np.log([*_LAGS_S]), np.log([*_FASTEST])
    low = np.array([0.0, *[ends[0][0]] * 2, *[ends[1][0]] * 2, *[-2.0] * len(traces)])
    high = np.array([2.0, *[ends[0][1]] * 2, *[ends[1][1]] * 2, *[2.0] * len(traces)])
    found = estimate(lambda p: left(p)[rows], start, low, high, split.blocks[rows])
    unit = np.eye(len(start))
    lags = [found.interval(*unit[k]).exponential() for k in (1, 2)]
    speeds = [found.interval(*unit[k]).exponential() for k in (3, 4)]
    fills, vents = (Interval(span * each.value, span * each.half) for each in speeds)
    return Filling(found.interval(*unit[0]), lags[0], lags[1], fills, vents, left(found.values))
