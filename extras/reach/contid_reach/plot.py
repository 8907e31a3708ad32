"""Figure of a reach report: regions in the plane, projections of volumes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import cycle
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from contid.units import MM_PER_M
from contid.whole_file import replacing
from contid_reach.planar import overlapping
from contid_reach.report import ReachReport

# Colour-blind safe (Okabe and Ito); more robots than colours begin them again.
_COLOURS = ("#0072B2", "#D55E00", "#CC79A7", "#E69F00", "#56B4E9")
_OVERLAP = "#009E73"
#: Empty cells around a silhouette.
_MARGIN = 2
CM3_PER_LITRE: Final = 1000.0
Array = NDArray[np.float64]


def save_plot(report: ReachReport, path: Path, title: str) -> None:
    """Draw a report; the suffix of ``path`` sets the format."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.2), layout="constrained")
    figure.suptitle(title)
    if report.regions:
        _draw_regions(figure.subplots(), report)
    else:
        _draw_volumes(figure.subplots(1, 2), report)
    figure.legend(loc="outside lower center", ncols=3, fontsize="small")
    with replacing(path) as file:
        figure.savefig(file, format=path.suffix[1:], dpi=110)


def _draw_regions(axes: Any, report: ReachReport) -> None:
    for (name, region), colour in zip(report.regions.items(), cycle(_COLOURS), strict=False):
        label = f"{name}: {report.areas_cm2[name]:.2f} cm²"
        _fill(axes, region, colour, 0.35, label)
    for pair, region in overlapping(report.regions).items():
        who = "both" if len(report.regions) == 2 else " and ".join(pair)
        _fill(axes, region, _OVERLAP, 0.8, f"{who}: {report.overlaps[pair]:.2f} cm²")
    _label(axes, "x", "y")


def _label(axes: Any, across: str, up: str) -> None:
    axes.set(aspect="equal", xlabel=f"{across} [mm]", ylabel=f"{up} [mm]")
    axes.grid(alpha=0.3)


def _fill(axes: Any, region: BaseGeometry, colour: str, alpha: float, label: str) -> None:
    """Draw a region [m], which has no holes, in millimetres; lines and points of it have no area."""
    from shapely import get_parts

    for part in get_parts(region):
        if part.geom_type != "Polygon" or part.is_empty:
            continue
        outline = np.asarray(part.simplify(2e-5).exterior.coords) * MM_PER_M
        axes.fill(outline[:, 0], outline[:, 1], color=colour, alpha=alpha, label=label, linewidth=0.8)
        label = "_nolegend_"


def _draw_volumes(panes: Any, report: ReachReport) -> None:
    """Contours of the volumes seen along y and along z."""
    for pane, (across, up) in zip(panes, ((0, 2), (0, 1)), strict=True):
        for (name, volume), colour in zip(report.volumes.items(), cycle(_COLOURS), strict=False):
            if not volume.voxels:
                continue
            edge_mm = volume.edge_m * MM_PER_M
            x, y, inside = silhouette(volume.voxels, across, up)
            pane.contourf(x * edge_mm, y * edge_mm, inside, levels=[0.5, 2.0], colors=[colour], alpha=0.45)
            pane.contour(x * edge_mm, y * edge_mm, inside, levels=[0.5], colors=[colour], linewidths=1.2)
            label = f"{name}: {volume_text(report.volumes_cm3[name])}"
            if pane is panes[0]:
                pane.fill([], [], color=colour, alpha=0.45, label=label)
        _label(pane, "xyz"[across], "xyz"[up])


def silhouette(voxels: Iterable[Sequence[int]], across: int, up: int) -> tuple[Array, Array, Array]:
    """Voxels seen along one axis: coordinates of a grid, and 0 to 1 at its points, smoothed at the edges.

    Args:
        voxels: numbers of the voxels along x, y and z.
        across: axis to the right.
        up: axis upwards.
    """
    flat = np.array(sorted({(voxel[across], voxel[up]) for voxel in voxels}))
    low = flat.min(axis=0) - _MARGIN
    grid = np.zeros(flat.max(axis=0) + _MARGIN + 1 - low)
    grid[tuple((flat - low).T)] = 1.0
    # A mean over nine cells moves no straight edge, and makes lines of the steps of slanted ones.
    smooth = np.mean([np.roll(grid, (i, j), (0, 1)) for i in (-1, 0, 1) for j in (-1, 0, 1)], axis=0)
    return np.arange(grid.shape[0]) + low[0], np.arange(grid.shape[1]) + low[1], smooth.T


def volume_text(volume_cm3: float) -> str:
    """A volume in litres from one litre on, else in cm³."""
    if volume_cm3 >= CM3_PER_LITRE:
        return f"{volume_cm3 / CM3_PER_LITRE:.3g} litres"
    return f"{volume_cm3:.3g} cm³"
