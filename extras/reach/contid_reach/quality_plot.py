"""Figure of quality maps: the plane of a planar robot, two sections of a spatial one."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from contid.kinematics.array import Array
from contid.units import MM_PER_M
from contid.whole_file import replacing
from contid_reach.quality import UNITS, QualityMap


def save_quality_plot(maps: Mapping[str, QualityMap], path: Path, title: str) -> None:
    """Draw maps, one row per robot; the suffix of ``path`` sets the format."""
    from matplotlib.colors import LogNorm, Normalize
    from matplotlib.figure import Figure

    columns = 1 if all(each.planar for each in maps.values()) else 2
    figure = Figure(figsize=(4.4 * columns + 1.2, 3.9 * len(maps)), layout="constrained")
    figure.suptitle(title)
    panes = figure.subplots(len(maps), columns, squeeze=False)
    for row, (name, each) in zip(panes, maps.items(), strict=True):
        low, high = each.quantile(0.01), each.quantile(0.99)
        # Compliances and accuracies may differ by decades between places.
        norm = LogNorm(low, high) if low > 0.0 and high > 10.0 * low else Normalize(low, high)
        drawn: Any = None
        for pane, (across, up) in zip(row, ((0, 1),) if each.planar else ((0, 2), (0, 1)), strict=False):
            x, y, values, where = section(each, across, up)
            drawn = pane.pcolormesh(x, y, values, norm=norm, cmap="viridis", shading="nearest")
            pane.set(aspect="equal", xlabel=f"{'xyz'[across]} [mm]", ylabel=f"{'xyz'[up]} [mm]")
            pane.set_title(name if each.planar else f"{name}, {where}", fontsize="medium")
        if each.planar and columns == 2:
            row[1].set_axis_off()
        unit = UNITS[each.measure][0]
        label = f"{each.measure} [{unit}]" if unit else str(each.measure)
        figure.colorbar(drawn, ax=list(row), label=label, extend="both")
    with replacing(path) as file:
        figure.savefig(file, format=path.suffix[1:], dpi=110)


def section(found: QualityMap, across: int, up: int) -> tuple[Array, Array, Array, str]:
    """Values in a plane of places: coordinates [mm], values, and where it is.

    The plane is that nearest to the median place; the median itself may be between two planes.

    Args:
        found: the map.
        across: axis to the right.
        up: axis upwards.

    Returns:
        Coordinates across ``(m,)`` and up ``(n,)``, values ``(n, m)`` with NaN outside, and such as
        ``y = 0 mm``.
    """
    cells: Any = np.round(found.points_m / found.edge_m).astype(int)
    through = 3 - across - up
    planes = np.unique(cells[:, through])
    middle = int(planes[np.argmin(np.abs(planes - np.median(cells[:, through])))])
    inside = cells[:, through] == middle
    flat, values = cells[inside][:, [across, up]], found.values[inside]
    low, high = flat.min(axis=0), flat.max(axis=0)
    grid = np.full(tuple((high - low + 1).tolist()), np.nan)
    grid[tuple((flat - low).T)] = values
    edge_mm = found.edge_m * MM_PER_M
    x, y = (np.arange(low[i], high[i] + 1) * edge_mm for i in (0, 1))
    return x, y, grid.T, f"{'xyz'[through]} = {middle * edge_mm:.0f} mm"
