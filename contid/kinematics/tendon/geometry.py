"""Geometry of a tendon robot: pulls of tendons and bends of sections map linearly, in both directions.

A tendon at the azimuth ``sigma`` and the distance ``d`` from the backbone ends at the disc of section j and
runs through all sections before it. Section k bends by ``Theta_k = theta_k (cos phi_k, sin phi_k)`` [rad].
The tendon's pull, positive when it shortens, is

    q = sum over k <= j of d (cos sigma, sin sigma) . Theta_k        i.e.  q = G Theta,

exactly for parallel routing, whatever the curvature does along the section. With ``routing: independent``
sheaths carry the tendon to its own section and only k = j counts. The two components of a bend times d are
the Clarke coordinates of Grassmann et al. (2024).

The base frame has its z axis along the straight backbone. The frame of a disc is that of the backbone there,
and the tip frame that of the last disc.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from contid.kinematics.arc import arc
from contid.kinematics.arc.sections import ArcChain
from contid.kinematics.array import Array
from contid.robot_file.tendon.sections import pull_matrix, tendon_arms
from contid.targets import ZERO3, Vec3


@dataclass(frozen=True, slots=True)
class TendonSection:
    """One section of the backbone and the tendons that end at its disc.

    Attributes:
        length_m: length of the backbone, which does not change [m].
        radius_m: distance of each tendon from the backbone [m].
        angle_rad: azimuth of each tendon, counter-clockwise from +x seen from +z [rad].
        rigid_m: rigid piece after the section [m].
    """

    length_m: float
    radius_m: tuple[float, ...]
    angle_rad: tuple[float, ...]
    rigid_m: float = 0.0

    @property
    def arms(self) -> Array:
        """``d (cos sigma, sin sigma)`` of each tendon [m], shape ``(tendons, 2)``."""
        return tendon_arms(self.radius_m, self.angle_rad)


@dataclass(frozen=True, eq=False)
class TendonGeometry:
    """Sections from the base to the tip.

    Attributes:
        sections: sections in their order from the base on.
        through: True when tendons run through the sections before their own and shorten with them too; False
            for ``routing: independent``.
        base_offset_m: distance of the start of section 1 from the origin of the base frame, along z [m].
        tip_offset_m: position of the tip in the tip frame, whose origin is the last disc [m].
        pull_matrix: G, which turns bends into pulls [m/rad], shape ``(tendons, 2 sections)``.
    """

    sections: tuple[TendonSection, ...]
    through: bool = True
    base_offset_m: float = 0.0
    tip_offset_m: Vec3 = ZERO3
    pull_matrix: Array = field(init=False)

    def __post_init__(self) -> None:
        matrix = pull_matrix([section.arms for section in self.sections], through=self.through)
        object.__setattr__(self, "pull_matrix", matrix)

    @property
    def count(self) -> int:
        """Number of sections."""
        return len(self.sections)

    @property
    def tendons(self) -> int:
        """Number of tendons of all sections."""
        return sum(len(section.radius_m) for section in self.sections)

    @cached_property
    def tendon_slices(self) -> tuple[slice, ...]:
        """For each section, which of all tendons end at its disc."""
        ends = np.cumsum([0, *(len(section.radius_m) for section in self.sections)])
        return tuple(slice(int(low), int(high)) for low, high in pairwise(ends))

    @cached_property
    def section_of(self) -> NDArray[np.intp]:
        """Number of the section at whose disc each tendon ends, shape ``(tendons,)``."""
        return np.repeat(np.arange(self.count), [len(section.radius_m) for section in self.sections])

    @cached_property
    def first_of(self) -> NDArray[np.intp]:
        """Number of the first tendon of each section, shape ``(sections,)``; for ``np.ufunc.reduceat``."""
        return np.array([rows.start for rows in self.tendon_slices])

    def pulls(self, bends: Array | Sequence[float]) -> Array:
        """Pulls ``(..., tendons)`` [m] of bends ``(..., 2 sections)`` [rad]."""
        pulls: Array = np.asarray(bends, dtype=np.float64) @ self.pull_matrix.T
        return pulls


@dataclass(frozen=True, slots=True)
class DiscFrames:
    """Ends of the sections in the base frame.

    Attributes:
        discs_m: end of each section, its rigid piece included [m], shape ``(..., sections, 3)``.
        rotations: matrices from the frame of each disc to the base frame, shape ``(..., sections, 3, 3)``.
        tip_m: position of the tip [m], shape ``(..., 3)``.
    """

    discs_m: Array
    rotations: Array
    tip_m: Array


def forward(geometry: TendonGeometry, bends: Array | Sequence[float]) -> DiscFrames:
    """Discs and tip in the base frame for bends ``(..., 2 sections)`` [rad], each section being an arc."""
    bends = np.asarray(bends, dtype=np.float64)
    batch = bends.shape[:-1]
    position = np.broadcast_to(np.array([0.0, 0.0, geometry.base_offset_m]), (*batch, 3))
    rotation = np.broadcast_to(np.eye(3), (*batch, 3, 3))
    discs, rotations = [], []
    for k, section in enumerate(geometry.sections):
        p, r = arc.pose(bends[..., 2 * k], bends[..., 2 * k + 1], np.array(section.length_m))
        position = position + (rotation @ (p + section.rigid_m * r[..., :, 2])[..., None])[..., 0]
        rotation = rotation @ r
        discs.append(position)
        rotations.append(rotation)
    tip = position + rotation @ np.array(geometry.tip_offset_m)
    return DiscFrames(np.stack(discs, axis=-2), np.stack(rotations, axis=-3), tip)


@dataclass(frozen=True, eq=False)
class BendSections(ArcChain):
    """The chain of arcs of a tendon robot in the variables of its solver, without the base offset.

    The variables of section s are ``x_s = L_s Theta_s`` [m], which move the tip by about their own size, so
    that the solver of arcs works with its own tolerances. The length of the backbone does not change.

    Attributes:
        backbone_m: length of each section [m].
        rigid_m: rigid piece after each section, the tip offset along the tangent included [m].
    """

    backbone_m: tuple[float, ...]
    rigid_m: tuple[float, ...]
    offset_m: tuple[float, float] = (0.0, 0.0)
    to_arc: Array = field(init=False)

    def __post_init__(self) -> None:
        per_length = 1.0 / np.array(self.backbone_m)
        object.__setattr__(self, "to_arc", per_length[:, None, None] * np.eye(3)[:, :2])

    @classmethod
    def of(cls, geometry: TendonGeometry) -> BendSections:
        """The chain of a geometry."""
        x_m, y_m, z_m = geometry.tip_offset_m
        rigid = [section.rigid_m for section in geometry.sections]
        rigid[-1] += z_m
        return cls(tuple(section.length_m for section in geometry.sections), tuple(rigid), (x_m, y_m))

    def arcs(self, lengths: Array | Sequence[float]) -> Array:
        """Bends and backbone lengths ``(..., n, 3)`` of variables ``(..., 2 n)`` [m]."""
        x = np.asarray(lengths, dtype=np.float64)
        backbone = np.array(self.backbone_m)
        bends = x.reshape(*x.shape[:-1], self.count, 2) / backbone[:, None]
        arcs: Array = np.concatenate(
            (bends, np.broadcast_to(backbone[:, None], (*bends.shape[:-1], 1))), axis=-1
        )
        return arcs
