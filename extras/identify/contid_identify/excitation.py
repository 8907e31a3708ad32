"""What a recording can show of an axis, before anything is fitted.

From the commands and the noise alone follow the smallest standard deviations that dead time and lag can have
(the Fisher information of white noise), at nominal values of both. Slow commands fix their sum only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from contid.kinematics.array import Array
from contid_identify.answer import CommandedTrace, answer

#: Nominal dead time and lag at which the information is computed [s].
_NOMINAL_S: Final = (0.05, 0.1)
#: Motion below this many times the noise shows nothing.
_LEAST_MOTION: Final = 10.0
#: Best 95 % interval of the dead time that is of use [s].
_OF_USE_S: Final = 0.02
#: Correlation of dead time and lag above which only their sum is known.
_ALIKE: Final = 0.98


@dataclass(frozen=True, slots=True)
class Excitation:
    """What the commands of an axis can show.

    Attributes:
        span: between the least and the greatest command, in the unit of the axis.
        noise: standard deviation of its measurements from one to the next.
        upper_hz: below it are 95 % of the power of the speed of the commands.
        delay_s, lag_s: half of the best possible 95 % intervals.
        alike: correlation of the estimates of dead time and lag, without sign.
        warnings: what the data cannot show, in sentences; empty when they can.
    """

    span: float
    noise: float
    upper_hz: float
    delay_s: float
    lag_s: float
    alike: float
    warnings: tuple[str, ...]

    @property
    def informative(self) -> bool:
        """False of commands that fix neither dead time nor lag; then the warnings have the reason."""
        return bool(np.isfinite(self.delay_s))

    @classmethod
    def of_nothing(cls, span: float, noise: float, warning: str) -> Excitation:
        """Of commands that fix neither dead time nor lag, with the reason."""
        return cls(
            span=span,
            noise=noise,
            upper_hz=0.0,
            delay_s=np.inf,
            lag_s=np.inf,
            alike=1.0,
            warnings=(warning,) if warning else (),
        )


def excitation_of(traces: Sequence[CommandedTrace]) -> Excitation:
    """What commands of one axis can show; ``sent`` is ``(ticks,)``, ``measured`` ``(samples, 1)``."""
    span = float(max(np.ptp(each.sent) for each in traces))
    noise = noise_of(np.concatenate([each.measured[:, 0] for each in traces]))
    if span <= _LEAST_MOTION * noise or span <= 0.0:
        return Excitation.of_nothing(span, noise, "it hardly moved: nothing about its delay and lag")
    information = sum(_information(each) for each in traces)
    if np.linalg.cond(information) > 1e12:
        warning = "its commands have one shape only: nothing about its delay and lag"
        return Excitation.of_nothing(span, noise, warning)
    covariance = np.linalg.inv(information) * max(noise, 1e-6 * span) ** 2
    delay_s, lag_s = (1.96 * np.sqrt(np.diag(covariance))).tolist()
    alike = abs(float(covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1])))
    found = Excitation(span, noise, _upper_hz(traces), delay_s, lag_s, alike, ())
    if delay_s <= _OF_USE_S:
        return found
    if alike > _ALIKE:
        warning = "its commands are slow: they show the sum of delay and lag, not each"
    else:
        warning = f"its delay is known to {1e3 * delay_s:.0f} ms at best: it moved too little"
    return replace(found, warnings=(warning,))


def noise_of(values: Array) -> float:
    """Standard deviation of white noise on smooth values: third differences, by their median size."""
    if len(values) < 4:
        return 0.0
    # Of white noise they have 1 + 9 + 9 + 1 times the variance; 0.6745 is the median size of a normal number.
    return float(np.median(np.abs(np.diff(values, 3))) / 0.6745 / np.sqrt(20.0))


def _information(trace: CommandedTrace) -> Array:
    delay_s, lag_s = _NOMINAL_S
    step = 1e-4

    def at(delay: float, lag: float) -> Array:
        return answer(trace.sent, trace.period_s, trace.at_s, delay, lag)

    columns = np.column_stack(
        (
            (at(delay_s + step, lag_s) - at(delay_s - step, lag_s)) / (2.0 * step),
            (at(delay_s, lag_s + step) - at(delay_s, lag_s - step)) / (2.0 * step),
        )
    )
    also = np.column_stack((np.ones(len(trace.at_s)), at(delay_s, lag_s)))
    columns -= also @ np.linalg.lstsq(also, columns, rcond=None)[0]
    return np.asarray(columns.T @ columns)


def _upper_hz(traces: Sequence[CommandedTrace]) -> float:
    """Of the longest trace in which the axis moves; one of them does."""
    moving = [each for each in traces if np.ptp(each.sent) > 0.0]
    longest = max(moving, key=lambda each: len(each.sent))
    power = np.abs(np.fft.rfft(np.diff(longest.sent))) ** 2
    total = np.cumsum(power)
    place = int(np.searchsorted(total, 0.95 * total[-1]))
    return float(np.fft.rfftfreq(len(longest.sent) - 1, longest.period_s)[place])
