"""Samples that are held, and smoothing within a stated distance.

Smoothing is a symmetric average with a kernel that keeps parabolas (a Gaussian times a quadratic). Its width
is chosen by leave-one-out cross-validation: each sample is predicted from all others,
``r_i = (y_i - s_i) / (1 - k_0)``, and the width with the least sum of squares is taken. Noise that is not
there is not smoothed away. Source: P. Craven and G. Wahba, "Smoothing noisy data with spline functions",
Numer. Math. 31, 1978, for a kernel in place of a spline.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from contid.trajectory.spline import cubic

Floats: TypeAlias = NDArray[np.float64]

#: Widths that are tried, in samples.
_WIDTHS: Final = tuple(0.6 * 1.35**n for n in range(14))
#: Longest run of equal rows that is a held sample, not rest.
_MOST_HELD: Final = 12


@dataclass(frozen=True, slots=True)
class Smoothed:
    """A smoothed path.

    Attributes:
        times: even [s].
        rows: shape ``(n, columns)``.
        nearest: for each, the row given that is nearest in time.
        greatest: distance of a given point from the curve [mm].
        rms: of these distances.
        width_s: of the kernel, 0 for none.
    """

    times: Floats
    rows: Floats
    nearest: NDArray[np.int64]
    greatest: float
    rms: float
    width_s: float


def held_rows(rows: Floats) -> tuple[NDArray[np.bool_], int]:
    """Which rows are new samples, and how many rows a sample is held for (1: none).

    Runs of equal rows that are much longer than usual are rest; they are kept.
    """
    changed = np.concatenate(([True], np.any(rows[1:] != rows[:-1], axis=1)))
    begins = np.flatnonzero(changed)
    runs = np.diff(np.append(begins, len(rows)))
    short = runs[runs <= _MOST_HELD]
    if len(short) < 5:
        return np.ones(len(rows), dtype=bool), 1
    usual = int(np.median(short))
    if (short > 1).mean() < 0.25:
        return np.ones(len(rows), dtype=bool), 1
    keep, usual = changed.copy(), max(usual, 2)
    for begin, run in zip(begins[runs > 2 * usual], runs[runs > 2 * usual], strict=True):
        keep[begin : begin + run : usual] = True
    keep[-1] = True
    return keep, usual


def smooth(times: Floats, rows: Floats, points: list[list[int]], within: float) -> Smoothed:
    """Smooth rows so that no point moves further than a distance.

    Args:
        times: growing [s], shape ``(n,)``.
        rows: shape ``(n, columns)``.
        points: for each point, the columns of its coordinates [mm]; other columns are smoothed alike.
        within: greatest distance [mm].
    """
    step = float(np.median(np.diff(times)))
    count = max(round((times[-1] - times[0]) / step), 1) + 1
    even = np.linspace(times[0], times[-1], count)
    given = rows if _is_even(times) else _at(times, rows, even)
    even = times if _is_even(times) else even
    chosen, width = given, 0.0
    best = np.inf
    for sigma in _WIDTHS:
        if 8.0 * sigma > len(given):
            break
        kernel = _kernel(sigma)
        found = _averaged(given, kernel)
        error = (given - found) / (1.0 - kernel[len(kernel) // 2])
        loss = float(np.sum(error**2))
        if _distances(times, rows, even, found, points).max(initial=0.0) > within:
            break
        if loss < best:
            best, chosen, width = loss, found, sigma
    distances = _distances(times, rows, even, chosen, points)
    nearest = np.clip(np.searchsorted(times, even), 0, len(times) - 1)
    rms = float(np.sqrt(np.mean(distances**2))) if distances.size else 0.0
    return Smoothed(even, chosen, nearest, float(distances.max(initial=0.0)), rms, width * step)


def _is_even(times: Floats) -> bool:
    steps = np.diff(times)
    return bool(np.abs(steps - steps.mean()).max(initial=0.0) < 0.01 * steps.mean())


def _at(times: Floats, rows: Floats, required: Floats) -> Floats:
    """Values of the cubic through rows at other times."""
    if len(times) < 3:
        return np.column_stack([np.interp(required, times, column) for column in rows.T])
    parts = cubic(times, rows)
    place = np.clip(np.searchsorted(times, required, side="right") - 1, 0, len(times) - 2)
    u = (required - times[place])[:, None]
    c = parts[place]
    found: Floats = ((c[:, 3] * u + c[:, 2]) * u + c[:, 1]) * u + c[:, 0]
    return found


def _distances(times: Floats, rows: Floats, even: Floats, found: Floats, points: list[list[int]]) -> Floats:
    at_rows = found if len(even) == len(times) and np.array_equal(even, times) else _at(even, found, times)
    moved = [np.linalg.norm(at_rows[:, place] - rows[:, place], axis=1) for place in points]
    moved = moved or [np.abs(at_rows - rows).max(axis=1)]
    result: Floats = np.max(moved, axis=0)
    return result


def _kernel(sigma: float) -> Floats:
    """A Gaussian times ``a - b x^2`` with the sum 1 and no second moment."""
    reach = int(np.ceil(4.0 * sigma)) + 1
    x = np.arange(-reach, reach + 1, dtype=float)
    gauss = np.exp(-0.5 * (x / sigma) ** 2)
    m0, m2, m4 = gauss.sum(), (gauss * x**2).sum(), (gauss * x**4).sum()
    kernel: Floats = gauss * (m4 - m2 * x**2) / (m0 * m4 - m2 * m2)
    return kernel


def _averaged(rows: Floats, kernel: Floats) -> Floats:
    """The average of every row with its neighbours; beyond its ends the curve is turned by half a turn."""
    reach = len(kernel) // 2
    reach = min(reach, len(rows) - 1)
    kernel = kernel[len(kernel) // 2 - reach : len(kernel) // 2 + reach + 1]
    before = 2.0 * rows[:1] - rows[reach:0:-1]
    behind = 2.0 * rows[-1:] - rows[-2 : -reach - 2 : -1]
    longer = np.concatenate([before, rows, behind])
    columns = [np.convolve(column, kernel, mode="valid") for column in longer.T]
    return np.column_stack(columns)
