"""Figure of a modulus fit, the way the paper shows it (Fig. 3): elongation and modulus over pressure."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from contid.calibrate.elongation_data import ElongationReading
from contid.calibrate.modulus import ModulusFit
from contid.kinematics.cosserat.section import MPA_PER_PA, Section


def plot_fits(
    path: Path, fits: Sequence[tuple[Section, ModulusFit]], readings: Sequence[ElongationReading]
) -> None:
    """Write the figure; its kind follows the file's ending."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    for section, found in fits:
        own = [
            reading
            for reading in readings
            if reading.section == found.section and reading.elongation_mm and reading.average_bar > 0.0
        ]
        x = np.array([reading.average_bar for reading in own])
        elongation = np.array([reading.elongation_mm for reading in own], float)
        push = 3.0 * section.pair_force / section.area / MPA_PER_PA
        grid = np.linspace(1e-3, found.measured_to_bar, 200)
        modulus = np.polyval(found.modulus_pa, grid)
        line = left.plot(grid, section.length * push * grid / modulus, label=f"section {found.section}")[0]
        left.plot(x, elongation, ".", color=line.get_color(), alpha=0.5)
        right.plot(grid, modulus / 1e3, color=line.get_color())
        right.plot(x, push * x / (elongation / section.length) / 1e3, ".", color=line.get_color(), alpha=0.5)
    left.set(xlabel="average pressure [bar]", ylabel="elongation [mm]")
    right.set(xlabel="average pressure [bar]", ylabel="modulus [kPa]")
    left.legend()
    figure.savefig(path)
