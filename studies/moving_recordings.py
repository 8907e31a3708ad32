"""Delay, lag, swing and tip of real robots in motion, beside black boxes.

``python -m studies.moving_recordings`` prints the tables.

Recordings: StanfordASL/trunk-stack (tendon trunk, 100 Hz) and ASU-RISE-Lab/4-chamber-softarm-control
(pneumatic, 27 to 84 Hz), both MIT, repacked in ``../shared/data/moving``; its README has the columns.

The split is that of `contid_identify.split`: 30 blocks of time, every fifth kept out, the same for all
methods. Widths and penalties of the black boxes were set beforehand, not by the blocks kept out.
"""

from __future__ import annotations

import csv
import gzip
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from contid.kinematics.array import Array
from contid_identify.answer import CommandedTrace
from contid_identify.delay_lag import AxisAnswer, fit_axis
from contid_identify.estimate import ErrorSize, error_of
from contid_identify.ring_down import Decay, fit_ring_downs
from contid_identify.split import split_time
from contid_identify.tip_answer import fit_tip

DATA: Final = Path(os.environ.get("CONTID_SHARED_DATA") or Path(__file__).parents[2] / "shared" / "data")
PERIOD_S: Final = 0.01
#: Past commands of the black boxes [s]: they reach over the dead time and the swing.
LAGS_S: Final = np.arange(0.0, 1.6, 0.08)
#: Penalty and width of the kernel, in standard deviations of the inputs; rows that it is fitted to.
PENALTY: Final = 1e-2
WIDTH: Final = 12.0
KERNEL_ROWS: Final = 2500
#: Order of the linear ARX, and how far ahead it predicts [s].
ORDER: Final = 6
AHEAD_S: Final = (0.03, 0.15, 0.3)


def table(path: str) -> dict[str, Array]:
    """Columns of one table by their names."""
    with gzip.open(DATA / "moving" / path, "rt", encoding="utf-8") as file:
        rows = csv.reader(file)
        names = next(rows)
        values = np.array([[float(cell) for cell in row] for row in rows])
    return dict(zip(names, values.T, strict=True))


def columns(of: dict[str, Array], names: Sequence[str]) -> Array:
    """Some columns of a table, side by side."""
    return np.column_stack([of[name] for name in names])


def smooth(values: Array) -> Array:
    """Medians of five rows: single frames jump."""
    padded = np.pad(values, ((2, 2), (0, 0)), mode="edge")
    return np.asarray(np.median(np.stack([padded[k : k + len(values)] for k in range(5)]), axis=0))


def changed(values: Array) -> Array:
    """Indices of the rows at which a value is new."""
    return np.append(0, np.flatnonzero(np.diff(values) != 0.0) + 1)


def size(error: ErrorSize) -> str:
    """An error with its interval."""
    return f"{error.rmse:6.2f} ({error.low:.2f} to {error.high:.2f})"


def answered(found: AxisAnswer, unit: str) -> str:
    """Delay, lag and errors kept out of one axis."""
    delay, lag, stages = found.delay_s, found.lag_s, found.stages
    return (
        f"delay {1e3 * delay.value:4.0f} +- {1e3 * delay.half:2.0f} ms, lag {1e3 * lag.value:4.0f} +- "
        f"{1e3 * lag.half:2.0f} ms, gain {found.gain.value:.3f}; kept out {stages[0].kept_out.rmse:.2f} -> "
        f"{size(stages[2].kept_out)} {unit}"
    )


def trunk_axes(of: dict[str, Array]) -> Iterator[str]:
    """Dead time and lag of the motors of the trunk, from published angles to angles that were read."""
    fresh = changed(columns(of, [f"phi{k}_deg" for k in range(1, 7)]).sum(axis=1))
    for k in range(1, 7):
        sent, read = of[f"u{k}_deg"], of[f"phi{k}_deg"][fresh][:, None]
        found = fit_axis([CommandedTrace(PERIOD_S, sent, fresh * PERIOD_S, read)])
        yield f"  motor {k}: {answered(found, 'deg')}"


def trunk_tip(of: dict[str, Array]) -> Iterator[str]:
    """The tip from commands alone, beside regressions."""
    sent = columns(of, [f"u{k}_deg" for k in range(1, 7)])
    tip = smooth(columns(of, ["x3_mm", "y3_mm", "z3_mm"]))
    at_s = np.arange(float(len(tip))) * PERIOD_S
    found = fit_tip([CommandedTrace(PERIOD_S, sent, at_s[::2], tip[::2])])
    yield f"  monomials of degree {found.degree} of {found.combinations} motors"
    for stage in found.stages:
        yield f"  {stage.name:24} {size(stage.kept_out)} mm"
    swing = "" if found.frequency_hz is None or found.ratio is None else (
        f", swing {found.frequency_hz.value:.2f} +- {found.frequency_hz.half:.2f} Hz, ratio {found.ratio.value:.2f}"
    )  # fmt: skip
    yield (
        f"  delay {1e3 * found.delay_s.value:.0f} +- {1e3 * found.delay_s.half:.0f} ms, lag "
        f"{1e3 * found.lag_s.value:.0f} +- {1e3 * found.lag_s.half:.0f} ms{swing}"
    )
    split = split_time(at_s)
    window = np.column_stack([_late(sent, round(lag_s / PERIOD_S)) for lag_s in LAGS_S])
    for name, method in (("linear FIR", ridge), ("kernel ridge", kernel_ridge)):
        predicted = method(window[split.fitted], tip[split.fitted], window[split.kept_out])
        error = error_of(tip[split.kept_out] - predicted, split.pieces[split.kept_out])
        yield f"  {name:24} {size(error)} mm"
    for ahead_s in AHEAD_S:
        ahead = round(ahead_s / PERIOD_S)
        parts = [_late(tip, ahead + 5 * k) for k in range(ORDER)] + [window]
        inputs = np.column_stack(parts)
        predicted = ridge(inputs[split.fitted], tip[split.fitted], inputs[split.kept_out])
        error = error_of(tip[split.kept_out] - predicted, split.pieces[split.kept_out])
        yield f"  linear ARX, {1e3 * ahead_s:3.0f} ms ahead   {size(error)} mm"


def trunk_decays(of: dict[str, Array]) -> Iterator[str]:
    """Frequency and damping of the releases; each half predicts the other half's."""
    tip = 1e-3 * smooth(columns(of, ["x3_mm", "y3_mm", "z3_mm"]))
    decays = []
    for number in np.unique(of["id"]):
        part = tip[of["id"] == number]
        decays.append(Decay(0.0, np.arange(float(len(part))) * PERIOD_S, part, 0.0, np.zeros(1), 1.0))
    for name, half in (("even", decays[0::2]), ("odd", decays[1::2])):
        (found,) = fit_ring_downs(half)
        low, high = found.range_hz
        for mode in found.modes:
            hz, ratio = mode.frequency_hz, mode.ratio
            yield (
                f"  {name} releases: {hz.value:.2f} +- {hz.half:.2f} Hz, ratio {ratio.value:.2f} +- "
                f"{ratio.half:.2f}; left {1e3 * found.noise_m:.2f} mm; singly {low:.2f} to {high:.2f} Hz"
            )


def chambers(path: str) -> Iterator[str]:
    """Dead time and lag of the pressures of the pneumatic arm behind their set-points."""
    of = table(path)
    at_s = of["t_s"] - of["t_s"][0]
    ticks = np.arange(0.0, float(at_s[-1]), PERIOD_S)
    rows = np.clip(np.searchsorted(at_s, ticks, side="right") - 1, 0, None)
    for section in (1, 2):
        for chamber in (1, 2, 3):
            sent = of[f"set{section}_{chamber}_psi"][rows]
            got = of[f"got{section}_{chamber}_psi"]
            fresh = changed(got)
            if np.ptp(sent) == 0.0:
                continue
            found = fit_axis([CommandedTrace(PERIOD_S, sent, at_s[fresh], got[fresh][:, None])])
            yield f"  {section}.{chamber}: {answered(found, 'psi')}"


def ridge(inputs: Array, outputs: Array, at: Array) -> Array:
    """Linear ridge regression with a constant."""
    middle, size = inputs.mean(axis=0), inputs.std(axis=0) + 1e-9
    x = np.column_stack(((inputs - middle) / size, np.ones(len(inputs))))
    normal = x.T @ x + 1e-3 * len(x) * np.diag(np.append(np.full(x.shape[1] - 1, 1e-2), 0.0))
    weights = np.linalg.solve(normal, x.T @ outputs)
    return np.asarray(np.column_stack(((at - middle) / size, np.ones(len(at)))) @ weights)


def kernel_ridge(inputs: Array, outputs: Array, at: Array) -> Array:
    """Ridge regression with a Gaussian kernel on every so many rows."""
    thin = max(len(inputs) // KERNEL_ROWS, 1)
    middle, size = inputs.mean(axis=0), inputs.std(axis=0) + 1e-9
    x, y = ((inputs - middle) / size)[::thin], outputs[::thin]
    mean = y.mean(axis=0)
    gram = _kernel(x, x)
    gram[np.diag_indices_from(gram)] += PENALTY
    weights = np.linalg.solve(gram, y - mean)
    return np.asarray(_kernel((at - middle) / size, x) @ weights + mean)


def _kernel(a: Array, b: Array) -> Array:
    apart = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1) - 2.0 * a @ b.T
    return np.asarray(np.exp(-0.5 * apart / WIDTH**2))


def _late(values: Array, ticks: int) -> Array:
    return values[np.clip(np.arange(len(values)) - ticks, 0, None)]


def report() -> Iterator[str]:
    """All tables."""
    for grams in (0, 100, 300):
        of = table(f"trunk-dynamic/random_a_{grams}g.csv.gz")
        yield f"trunk, {grams} g: motors"
        yield from trunk_axes(of)
        yield f"trunk, {grams} g: tip from commands alone, kept out"
        yield from trunk_tip(of)
    for name in ("decay_200g", "decay_demo"):
        yield f"trunk, {name}"
        yield from trunk_decays(table(f"trunk-dynamic/{name}.csv.gz"))
    for name in ("long_a", "steps_mar_1"):
        yield f"pneumatic, {name}: pressures from set-points"
        yield from chambers(f"pneumatic-planar/{name}.csv.gz")


if __name__ == "__main__":
    for line in report():
        print(line, flush=True)  # noqa: T201
