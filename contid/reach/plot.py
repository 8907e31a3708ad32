"""Figure of a reach report: regions in the plane, projections of volumes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from shapely.geometry.base import BaseGeometry

from contid.reach.planar import overlapping
from contid.reach.report import ReachReport
from contid.units import MM_PER_M

# Colour-blind safe (Okabe and Ito).
_COLOURS = ("#0072B2", "#D55E00", "#CC79A7", "#E69F00", "#56B4E9")
_OVERLAP = "#009E73"


def save_plot(report: ReachReport, path: Path, title: str) -> None:
    """Draw a report; the suffix of ``path`` sets the format."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.2), layout="constrained")
    figure.suptitle(title)
    if report.regions:
        _draw_regions(figure.subplots(), report)
    else:
        _draw_volumes(figure.subplots(1, 2), report)
    figure.savefig(path, dpi=110)


def _draw_regions(axes: Any, report: ReachReport) -> None:
    for colour, (name, region) in zip(_COLOURS, report.regions.items(), strict=False):
        label = f"{name}: {report.areas_cm2[name]:.2f} cm²"
        _fill(axes, region, colour, 0.35, label)
    for pair, region in overlapping(report.regions).items():
        _fill(axes, region, _OVERLAP, 0.8, f"both: {report.overlaps[pair]:.2f} cm²")
    _label(axes, "x", "y")
    axes.legend(loc="upper right", fontsize="small")


def _label(axes: Any, across: str, up: str) -> None:
    axes.set(aspect="equal", xlabel=f"{across} [mm]", ylabel=f"{up} [mm]")
    axes.grid(alpha=0.3)


def _fill(axes: Any, region: BaseGeometry, colour: str, alpha: float, label: str) -> None:
    from shapely import get_parts

    for part in get_parts(region):
        if part.geom_type != "Polygon":
            continue
        outline = np.asarray(part.simplify(2e-5).exterior.coords) * MM_PER_M
        axes.fill(outline[:, 0], outline[:, 1], color=colour, alpha=alpha, label=label, linewidth=0.8)
        label = "_nolegend_"


def _draw_volumes(panes: Any, report: ReachReport) -> None:
    for pane, (across, up) in zip(panes, ((0, 2), (0, 1)), strict=True):
        for colour, (name, volume) in zip(_COLOURS, report.volumes.items(), strict=False):
            edge_mm = volume.edge_m * MM_PER_M
            flat = sorted({(voxel[across], voxel[up]) for voxel in volume.voxels})
            if not flat:
                continue
            x, y = (np.array(flat, dtype=float) * edge_mm).T
            label = f"{name}: {report.volumes_cm3[name]:.4g} cm³"
            pane.bar(x, edge_mm, edge_mm, y - edge_mm / 2, color=colour, alpha=0.45, label=label, linewidth=0)
        _label(pane, "xyz"[across], "xyz"[up])
    panes[0].legend(loc="lower center", fontsize="small")
