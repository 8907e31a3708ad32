"""Figure of a calibration: error of every stage, and measured and predicted tips of the last one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from contid_fit.calibrate.tendon.recording import TendonRecording
from contid_fit.calibrate.tendon.stages import Stage


def plot_stages(path: Path, stages: Sequence[Stage], both: TendonRecording) -> None:
    """Write the figure; ``both`` are the training rows and those kept out. The suffix sets the format."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    places = np.arange(len(stages))
    for shift, label, kind in ((-0.18, "fitted", "train"), (0.18, "kept out", "held_out")):
        found = [getattr(stage, kind) for stage in stages]
        if any(each is None for each in found):
            continue
        values = 1e3 * np.array([each.rmse_m for each in found])
        ends = 1e3 * np.array([each.rmse_95_m for each in found]).T
        errors = np.maximum(np.abs(ends - values), 0.0)
        left.bar(places + shift, values, 0.34, yerr=errors, label=label, error_kw={"lw": 1.0})
    left.set_xticks(places, [stage.name for stage in stages], rotation=35, ha="right")
    left.set_ylabel("RMSE of the tip [mm], 95 %")
    left.legend()
    last = stages[-1]
    split = last.train.rows
    shown = slice(split, None) if split < len(both) else slice(None)
    measured, predicted = 1e3 * both.tip_m[shown], 1e3 * last.tip_m[shown]
    for axis, name in ((0, "x"), (1, "y")):
        line = right.plot(measured[:, axis], ".", ms=2.5, label=f"{name} measured")[0]
        right.plot(predicted[:, axis], color=line.get_color(), lw=0.9, label=f"{name} predicted")
    right.set(xlabel="row kept out" if split < len(both) else "row", ylabel="tip [mm]")
    right.legend()
    figure.savefig(path)
