"""The answer of an axis to its commands: dead time, then a first-order lag, exactly between samples.

A command ``u_k`` goes out at tick k and holds until the next one. Behind the dead time ``d`` the axis obeys

    x'(t) = (u(t - d) - x(t)) / tau

so that between two commands ``x`` is an exponential. It is evaluated at the time of each measurement; the
dead time may be any part of a period.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from contid.errors import ContidError
from contid.kinematics.array import Array


@dataclass(frozen=True, eq=False)
class CommandedTrace:
    """What was commanded at equal ticks, and what was measured at times of its own.

    Attributes:
        period_s: between two commands [s]; the first one is at time 0 and had held before.
        sent: commands, shape ``(ticks,)`` or ``(ticks, axes)``.
        at_s: times of the measurements, growing, shape ``(samples,)``.
        measured: shape ``(samples, columns)``.
        name: of the recording, in messages.
    """

    period_s: float
    sent: Array
    at_s: Array
    measured: Array
    name: str = ""

    def picked(self, rows: NDArray[np.bool_] | NDArray[np.intp]) -> CommandedTrace:
        """The same commands with some of the measurements only; ``rows`` is a mask or indices."""
        return replace(self, at_s=self.at_s[rows], measured=self.measured[rows])


def first_order(values: Array, period_s: float, lag_s: float) -> Array:
    """The lag's state at every tick, at rest before; ``values`` are held from tick to tick.

    Args:
        values: shape ``(ticks, ...)``, along the first axis.
        period_s: between two of them.
        lag_s: time constant; 0 gives the value that held before each tick.
    """
    from scipy.signal import lfilter

    keep = float(np.exp(-period_s / lag_s)) if lag_s > 0.0 else 0.0
    first = values[:1]
    return np.asarray(first + lfilter([0.0, 1.0 - keep], [1.0, -keep], values - first, axis=0))


def answer(sent: Array, period_s: float, at_s: Array, delay_s: float, lag_s: float) -> Array:
    """Values of an axis at times ``at_s``.

    Args:
        sent: commands ``(ticks,)`` or ``(ticks, columns)``.
        period_s: between two commands; the first is at time 0.
        at_s: times ``(samples,)``.
        delay_s: dead time.
        lag_s: time constant of the lag, 0 for none.

    Returns:
        Shape ``(samples,)`` or ``(samples, columns)``.
    """
    since = at_s - delay_s
    # A measurement at the time of a tick is one after its command; rounding must not take it before.
    ticks = np.clip(np.floor(since / period_s + 1e-9).astype(int), 0, len(sent) - 1)
    now = sent[ticks]
    if lag_s <= 0.0:
        return np.asarray(now)
    state = first_order(sent, period_s, lag_s)[ticks]
    left = np.exp(-np.maximum(since - ticks * period_s, 0.0) / lag_s)
    if sent.ndim > 1:
        left = left[:, None]
    found = now + (state - now) * left
    before = since < 0.0
    if before.any():
        found[before] = sent[0]
    return np.asarray(found)


def between(values: Array, places: Array) -> Array:
    """Rows at fractional places, linearly between two; the ends go on."""
    places = np.clip(places, 0.0, len(values) - 1.0)
    low = np.minimum(places.astype(int), len(values) - 2)
    share = (places - low)[:, None]
    return np.asarray(values[low] * (1.0 - share) + values[low + 1] * share)


def smoothly_between(values: Array, places: Array) -> Array:
    """Rows at fractional places of what has no corners, by cubics through neighbours (Catmull and Rom 1974).

    Straight lines between rows would take an eighth of the squared phase of a row off every swing, and a fit
    would take that for another frequency.
    """
    places = np.clip(places, 0.0, len(values) - 1.0)
    low = np.minimum(places.astype(int), len(values) - 2)
    s = (places - low)[:, None]
    before, here, after, then = (values[np.clip(low + k, 0, len(values) - 1)] for k in (-1, 0, 1, 2))
    slope = after - before
    bend = 2.0 * before - 5.0 * here + 4.0 * after - then
    turn = 3.0 * (here - after) + then - before
    return np.asarray(here + 0.5 * s * (slope + s * (bend + s * turn)))


def checked_commands(sent: Array, period_s: float, robot: str, axes: int) -> Array:
    """Commands ``(ticks, axes)`` as numbers.

    Raises:
        ContidError: commands of another number of axes, not finite, fewer than two, or without a period.
    """
    sent = np.asarray(sent, dtype=float)
    if sent.ndim != 2 or sent.shape[1] != axes:
        raise ContidError(f"{robot}: commands of shape {sent.shape}; needed: (ticks, {axes})")
    if len(sent) < 2 or not np.isfinite(sent).all() or not period_s > 0.0:
        raise ContidError(f"{robot}: commands must be finite, two at least, with a period above 0")
    return sent
