"""`Workspace`: the points that a tip reaches, exact outlines in the plane and voxels in space.

Beside it the drawing of backbones and coloured points with matplotlib, for `Robot.plot`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Protocol

from contid import entry_points
from contid.api.arguments import ArgumentError
from contid.api.units import Units
from contid.errors import MissingExtraError
from contid.kinematics.array import Array
from contid.kinematics.model import Model
from contid.robot_file.base import BasePose

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


@dataclass(frozen=True, eq=False)
class Workspace:
    """The reachable set of one tip in the world frame.

    Attributes:
        size: area of a planar robot [mm^2], volume of a spatial one [mm^3]; in SI m^2 and m^3.
        uncertainty: uncertainty of ``size``, in its unit: half the voxels at the boundary; 0 for exact areas.
        points: planar: the outline, parts separated by a row of NaN, shape ``(n, 2)``; spatial: centres of
            the reachable voxels, ``(n, 3)``.
        bounds: minimum and maximum of each coordinate over the points, shape ``(2, d)``.
        voxel: edge of a voxel; 0 for exact areas.
    """

    size: float
    uncertainty: float
    points: Array
    bounds: Array
    voxel: float


class MeasureWorkspace(Protocol):
    """Measures a workspace: an object of the group ``contid.workspaces``, ``planar`` or ``spatial``."""

    def __call__(
        self, model: Model, base: BasePose, units: Units, voxel: float | None, across: int
    ) -> Workspace:
        """Of a model at its base, in ``units``; see `contid.api.robot`."""
        ...


def measure_workspace(
    model: Model, base: BasePose, units: Units, voxel: float | None, across: int
) -> Workspace:
    """The workspace of a model, by the extra that measures it.

    Raises:
        ArgumentError: no installed package measures workspaces.
    """
    kind = "planar" if model.dimension == 2 else "spatial"
    measure: MeasureWorkspace | None = entry_points.load_one(entry_points.WORKSPACES, kind)
    if measure is None:
        raise ArgumentError(f"workspace: no installed package measures {kind} workspaces")
    return measure(model, base, units, voxel, across)
