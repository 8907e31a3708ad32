"""A motion by hand to a trajectory: smoothed, inside the limits, and slow enough for the rates of the robot.

Samples are filtered by a Gaussian on a uniform grid (``SIGMA_S``), which removes the noise of encoders and
the tremor of a hand (8 to 12 Hz; Elble, Koller 1990), then resampled. Where the hand was faster than the
robot, the whole motion is played slower.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
import numpy.typing as npt

from contid.errors import ContidError

Floats: TypeAlias = npt.NDArray[np.float64]

#: Standard deviation of the filter [s]; of 8 Hz it passes exp(-(2 pi 8 Hz s)^2 / 2), less than 5 %.
SIGMA_S: Final = 0.05
#: Rate of the uniform grid on which samples are filtered.
GRID_HZ: Final = 200.0
#: Shares of the limits of velocity, acceleration and jerk that a motion uses: the tick needs a reserve to
#: follow.
SHARES: Final = (0.8, 0.6, 0.4)
#: An axis that moves by less than this share of its travel stands still: that is noise.
STILL_SHARE: Final = 0.002
#: Standstill that is kept before and after the motion [s].
MARGIN_S: Final = 0.25
#: Fewer samples are no motion.
MIN_SAMPLES: Final = 5


@dataclass(frozen=True, slots=True)
class RecordedLimits:
    """Limits of the recorded axes, in their units (mm, bar or deg).

    Attributes:
        minimum, maximum: ends of the position, shape (axes,).
        rates: greatest velocity, acceleration and jerk [unit/s, unit/s^2, unit/s^3], shape (3, axes).
    """

    minimum: Floats
    maximum: Floats
    rates: Floats


@dataclass(frozen=True, slots=True)
class TaughtMotion:
    """A smoothed motion.

    Attributes:
        times_s: times of the rows, from 0, shape (rows,).
        rows: positions in the units of the limits, shape (rows, axes).
        slower: factor by which it is slower than the hand; 1 if it is as fast.
        clipped: samples of the recording outside the limits; those of the motion were moved to them.
    """

    times_s: Floats
    rows: Floats
    slower: float
    clipped: int


def taught_motion(times_s: Floats, samples: Floats, limits: RecordedLimits, rows_hz: float) -> TaughtMotion:
    """Smooth and resample measured positions.

    Args:
        times_s: times of the samples, growing, shape (n,).
        samples: positions in the units of the limits, shape (n, axes).
        limits: limits of the axes.
        rows_hz: rows per second of the result.

    Raises:
        ContidError: too few samples, or nothing moved.
    """
    times_s, places = np.unique(times_s, return_index=True)
    samples = samples[places]
    if len(times_s) < MIN_SAMPLES:
        raise ContidError(f"{len(times_s)} samples; a motion needs at least {MIN_SAMPLES}")
    outside = ((samples < limits.minimum) | (samples > limits.maximum)).any(axis=1)
    first, last = _moving(samples, limits)
    begin_s, end_s = times_s[first] - MARGIN_S, times_s[last] + MARGIN_S
    grid_s = np.arange(begin_s, end_s + 0.5 / GRID_HZ, 1.0 / GRID_HZ)
    # Outside the recording the end positions go on: the motion begins and ends at rest.
    held = np.vstack([samples[first], samples[first : last + 1], samples[last]])
    at_s = np.concatenate([[begin_s], times_s[first : last + 1], [end_s]])
    clipped = np.clip(held, limits.minimum, limits.maximum)
    dense = np.column_stack([np.interp(grid_s, at_s, column) for column in clipped.T])
    smooth = _smoothed(dense, SIGMA_S * GRID_HZ)
    slower = _slower(smooth, limits.rates)
    duration_s = (grid_s[-1] - grid_s[0]) * slower
    count = max(round(duration_s * rows_hz), 2)
    rows_s = np.linspace(0.0, duration_s, count + 1)
    dense_s = np.linspace(0.0, duration_s, len(grid_s))
    rows = np.column_stack([np.interp(rows_s, dense_s, column) for column in smooth.T])
    return TaughtMotion(rows_s, rows, slower, int(outside.sum()))


def _smoothed(dense: Floats, sigma: float) -> Floats:
    """A Gaussian filter along the first axis, of ``sigma`` samples; the ends go on before and behind."""
    reach = round(4.0 * sigma)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    padded = np.pad(dense, ((reach, reach), (0, 0)), mode="edge")
    return np.column_stack([np.convolve(column, weights / weights.sum(), "valid") for column in padded.T])


def _moving(samples: Floats, limits: RecordedLimits) -> tuple[int, int]:
    """Indices of the last sample before the motion and the first after it.

    Raises:
        ContidError: nothing moved.
    """
    still = STILL_SHARE * (limits.maximum - limits.minimum)
    after_start = (np.abs(samples - samples[0]) > still).any(axis=1)
    before_end = (np.abs(samples - samples[-1]) > still).any(axis=1)
    if not after_start.any():
        raise ContidError("nothing moved while it was recorded; is the torque off?")
    first = max(int(np.argmax(after_start)) - 1, 0)
    last = len(samples) - 1
    if before_end.any():
        last = min(len(samples) - int(np.argmax(before_end[::-1])), len(samples) - 1)
    return first, max(last, first + 1)


def _slower(smooth: Floats, rates: Floats) -> float:
    """The factor of time, at least 1, that keeps velocity, acceleration and jerk below their `SHARES`.

    A motion played s times slower has s times less velocity, s^2 less acceleration and s^3 less jerk.

    Args:
        smooth: positions at `GRID_HZ`, shape (n, axes).
        rates: limits, as `RecordedLimits.rates`.
    """
    factor = 1.0
    derivative = smooth
    for order, share in enumerate(SHARES, 1):
        derivative = np.gradient(derivative, 1.0 / GRID_HZ, axis=0)
        excess = float((np.abs(derivative) / (share * rates[order - 1])).max())
        factor = max(factor, excess ** (1.0 / order))
    return factor


def trajectory_csv(columns: tuple[str, ...], motion: TaughtMotion, saved: str) -> str:
    """The motion as a trajectory file; ``saved``, one line, is its comment."""
    lines = [f"# {saved}", "t_s," + ",".join(columns)]
    rows = zip(motion.times_s, motion.rows, strict=True)
    lines += [f"{time:.4f}," + ",".join(f"{value:.6f}" for value in row) for time, row in rows]
    return "\n".join(lines) + "\n"
