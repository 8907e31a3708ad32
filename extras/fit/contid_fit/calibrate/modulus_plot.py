"""Figure of a modulus fit, after Fig. 3 of Shi et al.: elongation and modulus over pressure."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from contid.kinematics.cosserat.section import Section
from contid.whole_file import replacing
from contid_fit.calibrate.elongation_data import ElongationReading, elongations
from contid_fit.calibrate.modulus import ModulusFit, axial_stress_pa


def plot_fits(
    path: Path, fits: Sequence[tuple[Section, ModulusFit]], readings: Sequence[ElongationReading]
) -> None:
    """Write the figure; the file's suffix sets its format."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    for section, found in fits:
        own = elongations(readings, found.section)
        x = np.array([reading.average_bar for reading in own])
        elongation = np.array([reading.elongation_mm for reading in own], float)
        grid = np.linspace(1e-3, found.measured_to_bar, 200)
        modulus = np.polyval(found.modulus_pa, grid)
        fitted_mm = section.length * axial_stress_pa(section, grid) / modulus
        line = left.plot(grid, fitted_mm, label=f"section {found.section}")[0]
        left.plot(x, elongation, ".", color=line.get_color(), alpha=0.5)
        right.plot(grid, modulus / 1e3, color=line.get_color())
        measured_pa = axial_stress_pa(section, x) / (elongation / section.length)
        right.plot(x, measured_pa / 1e3, ".", color=line.get_color(), alpha=0.5)
    left.set(xlabel="average pressure [bar]", ylabel="elongation [mm]")
    right.set(xlabel="average pressure [bar]", ylabel="modulus [kPa]")
    left.legend()
    with replacing(path) as file:
        figure.savefig(file, format=path.suffix[1:])
