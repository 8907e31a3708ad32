"""Delay, lag, swing and tip of real robots in motion, beside black boxes.

``python -m studies.moving.recordings`` prints the tables.

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
from contid_identify.answer import CommandedTrace, answer
from contid_identify.delay_lag import AxisAnswer, fit_axis
from contid_identify.estimate import ErrorSize, error_of
from contid_identify.ring_down import Decay, fit_ring_downs
from contid_identify.split import split_time
from contid_identify.tip_answer import fit_tip

DATA: Final = Path(os.environ.get("CONTID_SHARED_DATA") or Path(__file__).parents[2] / "shared" / "data")
PERIOD_S: Final = 0.01
MOTORS: Final = range(1, 7)
#: Past commands of the black boxes [s]: they reach over the dead time and the swing.
LAGS_S: Final = np.arange(0.0, 1.6, 0.08)
#: A release has begun when the tip moved this far; the motors have let go this much later [m, s].
MOVED_M: Final = 5e-3
RELEASE_S: Final = 0.25
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
        + (f"; filling and venting {size(stages[3].kept_out)}" if found.filling is not None else "")
    )


def trunk_motors(of: dict[str, Array]) -> list[AxisAnswer]:
    """Dead time and lag of the motors of the trunk, from published angles to angles that were read."""
    fresh = changed(columns(of, [f"phi{k}_deg" for k in MOTORS]).sum(axis=1))
    at_s = fresh * PERIOD_S
    return [
        fit_axis([CommandedTrace(PERIOD_S, of[f"u{k}_deg"], at_s, of[f"phi{k}_deg"][fresh][:, None])])
        for k in MOTORS
    ]


def trunk_tip(of: dict[str, Array], motors: Sequence[AxisAnswer]) -> Iterator[str]:
    """The tip from commands alone, beside regressions."""
    sent = columns(of, [f"u{k}_deg" for k in MOTORS])
    tip = smooth(columns(of, ["x3_mm", "y3_mm", "z3_mm"]))
    at_s = np.arange(float(len(tip))) * PERIOD_S
    # What the motors do by their own answers; none of their measurements is an input.
    turned = np.column_stack(
        [
            answer(sent[:, k], PERIOD_S, at_s, each.delay_s.value, each.lag_s.value)
            for k, each in enumerate(motors)
        ]
    )
    for name, inputs in (("commands", sent), ("answers of the motors", turned)):
        found = fit_tip([CommandedTrace(PERIOD_S, inputs, at_s[::2], tip[::2])])
        delay, lag = found.delay_s, found.lag_s
        yield (
            f"  behind the {name}: degree {found.degree}, delay {1e3 * delay.value:.0f} +- "
            f"{1e3 * delay.half:.0f} ms, lag {1e3 * lag.value:.0f} +- {1e3 * lag.half:.0f} ms"
        )
        if found.frequency_hz is not None and found.ratio is not None:
            hz = found.frequency_hz
            yield f"    swing {hz.value:.2f} +- {hz.half:.2f} Hz, ratio {found.ratio.value:.2f}"
        for stage in found.stages:
            yield f"    {stage.name:24} {size(stage.kept_out)} mm"
    split = split_time(at_s)
    fitted, kept, pieces = split.fitted, split.kept_out, split.pieces[split.kept_out]
    window = np.column_stack([_late(sent, round(lag_s / PERIOD_S)) for lag_s in LAGS_S])
    for name, method in (("linear FIR", ridge), ("kernel ridge", kernel_ridge)):
        predicted = method(window[fitted], tip[fitted], window[kept])
        yield f"    {name:24} {size(error_of(tip[kept] - predicted, pieces))} mm"
    for ahead_s in AHEAD_S:
        ahead = round(ahead_s / PERIOD_S)
        # Commands that are out already and still on their way may be used; later ones are not.
        past = [_late(tip, ahead + 5 * k) for k in range(ORDER)]
        inputs = np.column_stack([*past, window])
        predicted = ridge(inputs[fitted], tip[fitted], inputs[kept])
        name = f"linear ARX, {1e3 * ahead_s:.0f} ms ahead"
        yield f"    {name:24} {size(error_of(tip[kept] - predicted, pieces))} mm"


def trunk_decays(of: dict[str, Array]) -> Iterator[str]:
    """Frequency and damping of the releases, of each half of them, once the motors have let go."""
    tip = 1e-3 * smooth(columns(of, ["x3_mm", "y3_mm", "z3_mm"]))
    decays = []
    for number in np.unique(of["id"]):
        part = tip[of["id"] == number]
        moved = np.linalg.norm(part - part[0], axis=1) > MOVED_M
        part = part[int(np.argmax(moved)) + round(RELEASE_S / PERIOD_S) :]
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
    """Ridge regression with a Gaussian kernel on `KERNEL_ROWS` rows, evenly spread."""
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
    for name in ("long_a", "steps_mar_1"):
        yield f"pneumatic, {name}: pressures from set-points"
        yield from chambers(f"pneumatic-planar/{name}.csv.gz")
    for name in ("decay_200g", "decay_demo"):
        yield f"trunk, {name}"
        yield from trunk_decays(table(f"trunk-dynamic/{name}.csv.gz"))
    for grams in (0, 100, 300):
        of = table(f"trunk-dynamic/random_a_{grams}g.csv.gz")
        motors = trunk_motors(of)
        yield f"trunk, {grams} g: motors"
        yield from (f"  motor {k}: {answered(each, 'deg')}" for k, each in zip(MOTORS, motors, strict=True))
        yield f"trunk, {grams} g: tip from commands alone, kept out"
        yield from trunk_tip(of, motors)


if __name__ == "__main__":
    for line in report():
        print(line, flush=True)  # noqa: T201
