"""Friction, top speed and time constant of a servo from counts that it timed itself while it drove.

The model is that of `contid_bringup.drive_fit`. A host has the time when it sent a pulse, not that when the
servo began: its start on the servo's clock is found for every pulse. Least squares by the method of Levenberg
and Marquardt; the deviations are those of the linear problem at the solution.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from contid_bringup.drive_fit import DriveFit, MeanOfPulses
from contid_devices.pulsed_motors import DriveFacts, PulseAnswer

_Values = NDArray[np.float64]
#: Timed counts of a pulse that is used.
_TIMED_LEAST: Final = 8
_ROUNDS: Final = 60
_STEP: Final = 1e-6


def fit_timed(answers: Sequence[PulseAnswer], facts: DriveFacts) -> DriveFit | None:
    """The numbers behind the pulses of a servo; None when too few of two duties were timed.

    Args:
        answers: pulses of a proven servo.
        facts: what the manual states; only the start of the search.
    """
    timed = [answer for answer in answers if len(answer.timed) >= _TIMED_LEAST]
    if len({round(abs(answer.duty), 3) for answer in timed}) < 2:
        return None
    per_deg = facts.counts_per_rev / 360.0
    duty = np.abs([answer.duty for answer in timed])
    pulse = np.repeat(np.arange(len(timed)), [len(answer.timed) for answer in timed])
    time_s = np.concatenate([[each.time_s for each in answer.timed] for answer in timed])
    count = np.abs(np.concatenate([[each.counts for each in answer.timed] for answer in timed]))

    def off(values: _Values) -> _Values:
        top, friction, tau = np.exp(values[:3])
        since = np.maximum(time_s - values[3 + pulse], 0.0)
        speed = np.maximum(duty - friction, 0.0)[pulse] * top
        return np.asarray(speed * (since - tau * (1.0 - np.exp(-since / tau))) - count)

    start = [facts.no_load_deg_s * per_deg, 0.5 * duty.min(), facts.time_constant_s]
    guess = np.concatenate([np.log(start), np.zeros(len(timed))])
    found, deviations = _least_squares(off, guess)
    top, friction, tau = (
        MeanOfPulses(float(value), float(value * deviation))
        for value, deviation in zip(np.exp(found[:3]), deviations[:3], strict=True)
    )
    return DriveFit(friction, MeanOfPulses(top.value / per_deg, top.deviation / per_deg), tau)


class _Found(NamedTuple):
    """A solution and the standard deviations of its values."""

    values: _Values
    deviations: _Values


def _least_squares(off: Callable[[_Values], _Values], guess: _Values) -> _Found:
    """Values with the least sum of squares of ``off``, from a guess."""
    values, damping = guess.copy(), 1e-3
    error = off(values)
    for _ in range(_ROUNDS):
        jacobian = np.stack(
            [(off(values + _STEP * unit) - error) / _STEP for unit in np.eye(len(values))], axis=1
        )
        normal = jacobian.T @ jacobian
        damped = normal + damping * np.diag(np.diag(normal) + 1e-9)
        tried = values - np.linalg.solve(damped, jacobian.T @ error)
        after = off(tried)
        better = after @ after < error @ error
        if better:
            settled = error @ error - after @ after < 1e-9 * (error @ error)
            values, error, damping = tried, after, damping / 3.0
            if settled:
                break
        else:
            damping *= 4.0
    spread = error @ error / max(len(error) - len(values), 1)
    return _Found(values, np.sqrt(spread * (np.linalg.pinv(jacobian) ** 2).sum(axis=1)))
