"""Backbones and coloured points drawn by matplotlib, for `Robot.plot` of the library."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from contid.errors import MissingExtraError
from contid.kinematics.array import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Colour-blind safe (Okabe and Ito).
COLOURS: Final = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")


def new_axes(dimension: int, unit: str) -> Axes:
    """Axes of a new figure with equal scales: a plane, or space.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    try:
        import matplotlib.pyplot as plt
    except ImportError:
        raise MissingExtraError("plot", "matplotlib", "plots") from None
    figure = plt.figure(figsize=(7.0, 5.5), layout="constrained")
    axes: Any = figure.add_subplot(projection="3d" if dimension == 3 else None)
    axes.set(xlabel=f"x [{unit}]", ylabel=f"y [{unit}]")
    if dimension == 3:
        axes.set(zlabel=f"z [{unit}]")
    drawn: Axes = axes
    return drawn


def draw_points(axes: Any, points: Array, values: Array | None, label: str) -> None:
    """Scatter points ``(N, d)``, coloured by values with a bar."""
    drawn = axes.scatter(*points.T, c=values, s=4.0, cmap="viridis", alpha=0.5, linewidths=0.0)
    if values is not None:
        axes.figure.colorbar(drawn, ax=axes, label=label, shrink=0.7)


def draw_backbones(axes: Any, lines: Array) -> None:
    """Backbones ``(N, points, d)`` with a dot at each tip, above everything else."""
    for number, line in enumerate(lines):
        colour = COLOURS[number % len(COLOURS)]
        axes.plot(*line.T, color=colour, linewidth=2.5, zorder=10)
        axes.scatter(*line[-1:].T, color=colour, s=30.0, zorder=11)
