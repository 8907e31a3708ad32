"""Results of ``contid reach``: areas or volumes per robot, overlaps, the paper's comparison for hands."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from shapely.geometry.base import BaseGeometry

from contid.kinematics.frames import BaseFrame
from contid.kinematics.model import build_model_for_ticks
from contid.kinematics.rack.finger import RackFingerModel
from contid.robot_file.base import BasePose
from contid.robot_file.rack_finger import RackFinger
from contid.robot_file.robot import RobotDescription
from contid.units import MM_PER_M
from contid_reach.planar import area_cm2, overlapping, planar_regions
from contid_reach.spatial import Progress, Volume, reachable_volume, shared
from contid_reach.two_link import two_link_overlap

#: Figures that Morita et al. print in section IV-B.
PAPER_OVERLAP_CM2: Final = 14.77
PAPER_TWO_LINK_CM2: Final = {50: 1.00, 99: 14.77}


@dataclass(frozen=True, slots=True)
class ReachReport:
    """Reach of the robots of one file.

    Attributes:
        areas_cm2, volumes_cm3: areas of planar robots and volumes of spatial ones, by name.
        overlaps: overlaps by pair, in the unit of its robots (cm^2 or cm^3).
        regions: planar regions in the world [m], for plots.
        volumes: voxels, for plots.
        comparison: lines of the paper's comparison, name -> cm^2.
    """

    areas_cm2: Mapping[str, float] = field(default_factory=dict)
    volumes_cm3: Mapping[str, float] = field(default_factory=dict)
    overlaps: Mapping[tuple[str, str], float] = field(default_factory=dict)
    regions: Mapping[str, BaseGeometry] = field(default_factory=dict)
    volumes: Mapping[str, Volume] = field(default_factory=dict)
    comparison: Mapping[str, float] = field(default_factory=dict)

    def to_json(self) -> dict[str, object]:
        """The numbers for ``--json``."""
        out: dict[str, object] = {}
        if self.areas_cm2:
            out["area_cm2"] = dict(self.areas_cm2)
        if self.volumes:
            out["volume_cm3"] = dict(self.volumes_cm3)
            out["volume_uncertainty_cm3"] = {
                name: volume.uncertainty_m3 * 1e6 for name, volume in self.volumes.items()
            }
            out["voxel_mm"] = next(iter(self.volumes.values())).edge_m * MM_PER_M
            out["bounds_mm"] = {
                name: (np.array(volume.bounds_m()) * MM_PER_M).tolist()
                for name, volume in self.volumes.items()
            }
        unit = "overlap_cm2" if self.areas_cm2 else "overlap_cm3"
        out[unit] = {f"{a} {b}": value for (a, b), value in self.overlaps.items()}
        if self.comparison:
            out["comparison_cm2"] = dict(self.comparison)
        return out


def planar_report(fingers: Mapping[str, RackFinger]) -> ReachReport:
    """Exact areas of rack fingers, and for two of them the comparison of Morita et al., section IV-B."""
    models = {name: RackFingerModel(finger) for name, finger in fingers.items()}
    regions = planar_regions(models, {name: finger.base for name, finger in fingers.items()})
    return ReachReport(
        areas_cm2={name: area_cm2(region) for name, region in regions.items()},
        overlaps={pair: area_cm2(region) for pair, region in overlapping(regions).items()},
        regions=regions,
        comparison=_paper_comparison(fingers) if len(fingers) == 2 else {},
    )


def _paper_comparison(fingers: Mapping[str, RackFinger]) -> dict[str, float]:
    """Section IV-B with the values of its text: no tip length, the racks of the file, no correction."""
    first, second = fingers.values()
    spacing_m = math.dist(first.base.position_m, second.base.position_m)
    geometry = first.geometry.model_copy(update={"tip_length_mm": 0.0})
    bare = first.model_copy(update={"geometry": geometry, "correction": None, "base": BasePose()})
    facing = BasePose(x_mm=spacing_m * MM_PER_M, mirror_x=True)
    model = RackFingerModel(bare)
    regions = planar_regions({"a": model, "b": model}, {"a": BasePose(), "b": facing})
    overlap = overlapping(regions)["a", "b"]
    width = first.geometry.rack_spacing_mm
    lines = {f"rack fingers, h = 0, w = {width:g} mm": area_cm2(overlap)}
    for degrees in PAPER_TWO_LINK_CM2:
        region = two_link_overlap(math.radians(degrees), spacing_m)
        lines[f"two rigid links of 50 mm, joints to {degrees} deg either side"] = area_cm2(region)
    return lines


def spatial_report(
    robots: Mapping[str, RobotDescription],
    edge_mm: float | None,
    across: int,
    progress: Progress | None = None,
) -> ReachReport:
    """Voxel volumes of spatial arms on one common grid.

    Args:
        robots: descriptions by name.
        edge_mm: edge of a voxel [mm]; None gives the widest side of the first arm ``across`` voxels.
        across: see ``edge_mm``.
        progress: called with the number of voxels tested so far.
    """
    volumes: dict[str, Volume] = {}
    edge_m = None if edge_mm is None else edge_mm / MM_PER_M
    for name, robot in robots.items():
        model, frame = build_model_for_ticks(robot), BaseFrame.of(robot.base)
        volumes[name] = reachable_volume(model, frame, edge_m=edge_m, across=across, progress=progress)
        edge_m = volumes[name].edge_m
    return ReachReport(
        volumes_cm3={name: volume.volume_m3 * 1e6 for name, volume in volumes.items()},
        overlaps={pair: value * 1e6 for pair, value in shared(volumes).items()},
        volumes=volumes,
    )


def with_unit(volume_m3: float, uncertainty_m3: float) -> str:
    """A volume with its uncertainty, in litres from one litre on, else in cm3."""
    per_m3, unit, digits = (1e3, "litres", 1) if volume_m3 >= 1e-3 else (1e6, "cm3", 0)
    return f"{volume_m3 * per_m3:.{digits}f} +- {uncertainty_m3 * per_m3:.{digits}f} {unit}"
