"""Friction, top speed and time constant of a motor from its pulses, with their uncertainty.

Model: tau dv/dt = (|duty| - f) v0 - v under drive; then -f v0 - v with the terminals shorted, -f v0 without.

A count is the place of the shaft rounded down, so a pulse that starts at the unknown part x of a count shows
counts n with n <= place + x < n + 1 at every sample. With x anywhere between 0 and 1, the likelihood of the
counts is the length of the interval of x that agrees with all of them. The posterior over friction, time
constant and v0 / tau is sampled by Metropolis' method (Metropolis et al., J. Chem. Phys. 21, 1953); mean and
standard deviation are reported.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from contid_bringup.probing import DUTY_MOST, PULSE_S, Pulse, from_rest, way_deg
from contid_devices.pulsed_motors import DriveFacts, PulseAnswer

_Values = NDArray[np.float64]
#: A number is stated when its standard deviation is at most this share of it.
CERTAIN: Final = 0.03
#: Pulses in each direction, and where the duty lies between friction and 20 %, of short and long pulses.
_REPEATED: Final = 8
_SHARES: Final = (0.5, 1.0)
_LONG_REPEATED: Final = 5
_LONG_SHARES: Final = (0.1, 1.0)
DURATIONS_S: Final = (0.030, 0.027, 0.025, 0.028, 0.024, 0.029, 0.026)
#: Way of a pulse that is longer than those of a probe, by the robot file, and the steps of its duration.
MEASURED_DEG: Final = 8.0
_SHORTER_S: Final = 0.005
#: Steps of the walk: to settle, and to sample.
_SETTLE: Final = 1500
_SAMPLE: Final = 1500
#: The walk begins with likelihoods flattened by this power, so that it leaves a wrong start.
_HEAT: Final = 30.0
#: A pulse that no place agrees with counts as this likely, less with each of these parts of a count beyond.
_UNLIKELY: Final = 0.02
_PART: Final = 0.1
#: Bounds of the logarithms of v0 / tau [counts/s^2], tau [s], friction.
_LOWEST: Final = np.log([1e2, 2e-3, 2e-3])
_HIGHEST: Final = np.log([1e8, 1.0, 0.2])


class MeanOfPulses(NamedTuple):
    """A number with its standard deviation."""

    value: float
    deviation: float

    @property
    def certain(self) -> bool:
        """True when the deviation is small enough to state the number."""
        return self.deviation <= CERTAIN * abs(self.value)


class DriveFit(NamedTuple):
    """What the pulses show about a motor.

    Attributes:
        friction: share of full duty that just keeps it turning.
        no_load_deg_s: speed at full duty without friction.
        time_constant_s: response of its speed.
    """

    friction: MeanOfPulses
    no_load_deg_s: MeanOfPulses
    time_constant_s: MeanOfPulses


def measure(pulse: Pulse, found_duty: float, facts: DriveFacts) -> list[PulseAnswer]:
    """Pulses of a proven motor for `fit_drive`: two duties, there and back in turn; a fault ends them.

    Their durations differ, so that each starts at another part of a count: pulses that repeat each other
    exactly would count as more knowledge than they are. A device that allows longer ones than those of a
    probe turns by about `MEASURED_DEG`.
    """
    pulse = from_rest(pulse)
    durations = itertools.cycle(DURATIONS_S)
    answers = []
    long = facts.longest_s > PULSE_S
    for share in _LONG_SHARES if long else _SHARES:
        duty = found_duty + (DUTY_MOST - found_duty) * share
        longest_s = facts.longest_s
        while longest_s > PULSE_S and way_deg(facts, duty, longest_s) > MEASURED_DEG:
            longest_s -= _SHORTER_S
        for sign in (+1.0, -1.0) * (_LONG_REPEATED if long else _REPEATED):
            answers.append(pulse(sign * duty, next(durations) * longest_s / PULSE_S))
            if answers[-1].fault:
                return answers
    return answers


def fit_drive(answers: Sequence[PulseAnswer], facts: DriveFacts) -> DriveFit | None:
    """The numbers behind the pulses; None when they moved too little.

    Args:
        answers: pulses of a proven motor.
        facts: what the robot file states; only the start of the search.
    """
    moving = [answer for answer in answers if answer.duty and abs(answer.positions[-1]) >= 2]
    if len(moving) < 4:
        return None
    per_deg = facts.counts_per_rev / 360.0
    least = min(abs(answer.duty) for answer in moving)
    tau = max(facts.time_constant_s, 5e-3)
    start = np.log([facts.no_load_deg_s * per_deg / tau, tau, min(max(facts.friction, 0.01), 0.8 * least)])
    seen = _seen(moving)
    starts = [start + math.log(factor) * np.array([0.0, 1.0, 0.0]) for factor in (0.5, 2.0)]
    # Two walks from either side: where they disagree, the deviation grows.
    walked = np.concatenate(
        [_walk(np.clip(s, _LOWEST + 0.01, _HIGHEST - 0.01), seen, facts.brakes) for s in starts]
    )
    push, tau_s, friction = np.exp(walked).T
    return DriveFit(_estimate(friction), _estimate(push * tau_s / per_deg), _estimate(tau_s))


def _estimate(values: _Values) -> MeanOfPulses:
    return MeanOfPulses(float(values.mean()), float(values.std()))


class _Seen(NamedTuple):
    """Pulses as arrays: duty and duration, shape (pulses, 1); counts along the drive, (pulses, samples)."""

    duty: _Values
    driven_s: _Values
    counts: _Values


def _seen(answers: Sequence[PulseAnswer]) -> _Seen:
    signs = [math.copysign(1.0, answer.duty) for answer in answers]
    return _Seen(
        np.array([[abs(answer.duty)] for answer in answers]),
        np.array([[answer.driven_s] for answer in answers]),
        np.array(
            [np.asarray(answer.positions) * sign for answer, sign in zip(answers, signs, strict=True)], float
        ),
    )


def _walk(logs: _Values, seen: _Seen, brakes: bool) -> _Values:
    """Samples of the posterior; shape (`_SAMPLE`, 3). The steps are those of the walk so far."""
    rng = np.random.default_rng(0)
    score = _log_likelihood(logs, seen, brakes)
    steps: _Values = 0.1 * np.eye(3)
    path = np.empty((_SETTLE + _SAMPLE, 3))
    for i in range(len(path)):
        tried = logs + steps @ rng.standard_normal(3)
        if np.all((tried > _LOWEST) & (tried < _HIGHEST)):
            after = _log_likelihood(tried, seen, brakes)
            heat = _HEAT ** max(1.0 - i / (0.7 * _SETTLE), 0.0)
            if math.log(rng.random() + 1e-300) < (after - score) / heat:
                logs, score = tried, after
        path[i] = logs
        if i in (300, 600, 900, 1200, 1400):
            spread = np.cov(path[i - 200 : i].T) + 1e-8 * np.eye(3)
            steps = np.asarray(np.linalg.cholesky(spread) * 1.2, np.float64)
    return path[_SETTLE:]


def _log_likelihood(logs: _Values, seen: _Seen, brakes: bool) -> float:
    push, tau, friction = np.exp(logs)
    if friction >= seen.duty.min():
        return -math.inf
    off = seen.counts - places(
        push * tau, tau, friction, seen.duty, seen.driven_s, brakes, seen.counts.shape[1]
    )
    agree = 1.0 - np.maximum(off.max(axis=1), 0.0) + np.minimum(off.min(axis=1), 0.0)
    beyond = np.minimum(agree - _UNLIKELY, 0.0) / _PART
    return float((np.log(np.maximum(agree, _UNLIKELY)) + beyond).sum())


def places(
    top: float, tau: float, friction: float, duty: _Values, driven_s: _Values, brakes: bool, samples: int
) -> _Values:
    """Places [counts] of a motor 1, 2, ... ``samples`` ms after the start of pulses; shape (pulses, samples).

    Args:
        top: speed at full duty without friction [counts/s].
        tau: time constant [s].
        friction: share of full duty.
        duty: of the pulses, shape (pulses, 1).
        driven_s: their durations [s], shape (pulses, 1).
        brakes: the terminals are shorted after the drive.
        samples: number of milliseconds.
    """
    time_s = np.arange(1, samples + 1) * 1e-3
    excess = np.maximum(duty - friction, 0.0) * top
    hold = friction * top
    driven = np.minimum(time_s, driven_s)
    place = excess * (driven - tau * (1.0 - np.exp(-driven / tau)))
    speed = excess * (1.0 - np.exp(-driven_s / tau))
    after = np.maximum(time_s - driven_s, 0.0)
    if brakes:
        after = np.minimum(after, tau * np.log1p(speed / hold))
        return np.asarray(place + (speed + hold) * tau * (1.0 - np.exp(-after / tau)) - hold * after)
    after = np.minimum(after, speed * tau / hold)
    return np.asarray(place + speed * after - 0.5 * hold / tau * after**2)
