"""Figure of a curvature fit, after Fig. 8 of Morita et al.: k over k_d, and epsilon over S with its line."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from contid.whole_file import replacing
from contid_fit.calibrate.curvature import CurvatureFit


def plot_curvature(path: Path, fit: CurvatureFit) -> None:
    """Write the figure; the file's suffix sets its format."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    lengths = np.array([posture.arc_length_mm for posture in fit.postures])
    commanded = np.array([posture.commanded_per_mm for posture in fit.postures])
    actual = np.array([posture.circle.curvature for posture in fit.postures])
    dots = left.scatter(commanded, actual, c=lengths, cmap="viridis", s=18)
    end = float(commanded.max()) * 1.05
    left.plot([0, end], [0, end], color="0.6", linewidth=1, label="as commanded")
    left.set(xlabel="commanded curvature [1/mm]", ylabel="fitted curvature [1/mm]")
    left.legend()
    figure.colorbar(dots, ax=left, label="S [mm]")
    right.plot(lengths, [posture.epsilon for posture in fit.postures], "o", markersize=4)
    grid = np.linspace(*fit.arc_length_mm, 2)
    right.plot(grid, fit.a_per_mm * grid + fit.b, label=f"{fit.a_per_mm:.5f} S {fit.b:+.4f}")
    right.set(xlabel="arc length S [mm]", ylabel="epsilon = k/k_d - 1")
    right.legend()
    with replacing(path) as file:
        figure.savefig(file, format=path.suffix[1:], dpi=110)
