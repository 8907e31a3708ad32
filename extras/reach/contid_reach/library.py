"""`contid.api.workspace.Workspace` of a model: what `Robot.workspace` returns."""

from __future__ import annotations

import math

import numpy as np

from contid.api.arguments import ArgumentError
from contid.api.units import Units
from contid.api.workspace import Workspace
from contid.errors import MissingExtraError
from contid.kinematics.array import Array
from contid.kinematics.frames import BaseFrame
from contid.kinematics.model import Model
from contid.kinematics.rack.finger import RackFingerModel
from contid.robot_file.base import BasePose


def planar_workspace(
    model: Model, base: BasePose, units: Units, voxel: float | None, across: int
) -> Workspace:
    """The exact area of a planar finger; ``voxel`` and ``across`` are not needed.

    Raises:
        ArgumentError: a planar model without an exact region.
        MissingExtraError: shapely is not installed.
    """
    if not isinstance(model, RackFingerModel):
        raise ArgumentError(f"workspace: no region is defined for planar {type(model).__name__}")
    try:
        from shapely import get_parts

        from contid_reach.planar import finger_region, to_world
    except ImportError:
        raise MissingExtraError("workspace", "shapely", "plots") from None
    region = to_world(finger_region(model), base)
    gap = np.full((1, 2), math.nan)
    parts: list[Array] = []
    for part in get_parts(region):
        if part.geom_type == "Polygon":
            for ring in (part.exterior, *part.interiors):
                parts += [gap, np.asarray(ring.coords)[:, :2]]
    points = units.from_si(np.concatenate(parts[1:]))
    scale = units.scale()
    bounds = np.array([np.nanmin(points, axis=0), np.nanmax(points, axis=0)])
    return Workspace(float(region.area) * scale**2, 0.0, points, bounds, 0.0)


def spatial_workspace(
    model: Model, base: BasePose, units: Units, voxel: float | None, across: int
) -> Workspace:
    """The voxels whose centres the inverse reaches; see `contid_reach.spatial`.

    Without ``voxel``, the edge of a voxel is the widest side of the workspace divided by ``across``.
    """
    from contid_reach.spatial import reachable_volume

    scale = units.scale()
    if voxel is not None and not voxel > 0.0:
        raise ArgumentError(f"voxel={voxel}: a positive length is needed")
    frame = BaseFrame.of(base)
    volume = reachable_volume(model, frame, edge_m=None if voxel is None else voxel / scale, across=across)
    centres = np.array(sorted(volume.voxels), dtype=float).reshape(-1, 3) * volume.edge_m
    return Workspace(
        volume.volume_m3 * scale**3,
        volume.uncertainty_m3 * scale**3,
        units.from_si(centres),
        units.from_si(np.array(volume.bounds_m())),
        volume.edge_m * scale,
    )
