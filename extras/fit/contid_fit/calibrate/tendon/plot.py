"""Figure of a calibration: error of every stage, and measured and predicted tips of the last one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from contid.whole_file import replacing
from contid_fit.calibrate.tendon.recording import TendonRecording
from contid_fit.calibrate.tendon.stages import Stage


def plot_stages(path: Path, stages: Sequence[Stage], both: TendonRecording) -> None:
    """Write the figure.

    Args:
        path: file to write; its suffix sets the format.
        stages: stages of the calibration in their order; tips are those of the last one.
        both: the training rows, then those kept out.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 4.2), layout="constrained")
    error_axes, tip_axes = figure.subplots(1, 2)
    bar_positions = np.arange(len(stages))
    for shift, label, kind in ((-0.18, "fitted", "train"), (0.18, "kept out", "held_out")):
        accuracies = [getattr(stage, kind) for stage in stages]
        if any(accuracy is None for accuracy in accuracies):
            continue
        rmse_mm = 1e3 * np.array([accuracy.rmse_m for accuracy in accuracies])
        interval_mm = 1e3 * np.array([accuracy.rmse_95_m for accuracy in accuracies]).T
        half_widths_mm = np.maximum(np.abs(interval_mm - rmse_mm), 0.0)
        positions = bar_positions + shift
        error_axes.bar(positions, rmse_mm, 0.34, yerr=half_widths_mm, label=label, error_kw={"lw": 1.0})
    error_axes.set_xticks(bar_positions, [stage.name for stage in stages], rotation=35, ha="right")
    error_axes.set_ylabel("RMSE of the tip [mm], 95 %")
    error_axes.legend()
    last = stages[-1]
    training_rows = last.train.rows
    shown = slice(training_rows, None) if training_rows < len(both) else slice(None)
    measured, predicted = 1e3 * both.tip_m[shown], 1e3 * last.tip_m[shown]
    for column, name in ((0, "x"), (1, "y")):
        line = tip_axes.plot(measured[:, column], ".", ms=2.5, label=f"{name} measured")[0]
        tip_axes.plot(predicted[:, column], color=line.get_color(), lw=0.9, label=f"{name} predicted")
    tip_axes.set(xlabel="row kept out" if training_rows < len(both) else "row", ylabel="tip [mm]")
    tip_axes.legend()
    with replacing(path) as file:
        figure.savefig(file, format=path.suffix[1:])
