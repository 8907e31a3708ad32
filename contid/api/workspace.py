"""`Workspace`: the points that a tip reaches, exact outlines in the plane and voxels in space."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from contid import entry_points
from contid.api.arguments import ArgumentError
from contid.api.units import Units
from contid.kinematics.array import Array
from contid.kinematics.model import Model
from contid.robot_file.base import BasePose


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
