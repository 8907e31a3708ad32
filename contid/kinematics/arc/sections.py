"""A chain of constant-curvature sections, each bent by three parallel lengths, with rigid pieces between.

A tube (or rack) at the angle ``a_i`` and the distance ``d`` from the backbone has the length

    l_i = L - d (u cos a_i + v sin a_i),

exactly, for every torsion-free curve with the bending vector (u, v), so lengths and arcs map linearly. A
rigid piece of ``rigid_m[i]`` along the local z follows section i. Vectorised over leading dimensions.

Errata this corrects: Hughes et al. Eq. 3 has a wrong sign in M(2,3) (equal racks would bend, and M is
singular at phi = pi) and states twice the bend (Dx is half a difference); Singh et al. never state the
layout, and their Eq. 2 holds for tubes at 180, 60 and -60 degrees only.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from contid.kinematics.arc import arc
from contid.kinematics.array import Array


class ArcChain(ABC):
    """A chain of arcs whose variables map linearly to ``(u, v, L)``.

    Attributes:
        rigid_m: length of the rigid piece after each section [m].
        offset_m: offset of the tip across the last tangent, in the tip frame [m].
        to_arc: derivatives of (u, v, L) by the variables of each section, shape ``(n, 3, columns)``.
    """

    rigid_m: tuple[float, ...]
    offset_m: tuple[float, float] = (0.0, 0.0)
    to_arc: Array

    @property
    def count(self) -> int:
        """Number of sections."""
        return len(self.rigid_m)

    @abstractmethod
    def arcs(self, lengths: Array | Sequence[float]) -> Array:
        """Arcs (u, v, L), shape ``(..., n, 3)``, of variables ``(..., n columns)`` [m]."""


@dataclass(frozen=True, eq=False)
class Sections(ArcChain):
    """Geometry of a chain that tubes or racks bend; its variables are their lengths.

    Attributes:
        radius_m: distance of the tubes from the backbone, one per section [m]; the mean of a tapered section.
        angles_rad: azimuth of the three tubes of each section, counter-clockwise from +x seen from +z.
        to_lengths: inverses of ``to_arc``.
    """

    radius_m: tuple[float, ...]
    angles_rad: tuple[tuple[float, float, float], ...]
    rigid_m: tuple[float, ...]
    to_arc: Array = field(init=False)
    to_lengths: Array = field(init=False)

    def __post_init__(self) -> None:
        angles = np.array(self.angles_rad)
        radius = np.array(self.radius_m)[:, None]
        rows = np.stack((-radius * np.cos(angles), -radius * np.sin(angles), np.ones_like(angles)), axis=-1)
        object.__setattr__(self, "to_lengths", rows)
        object.__setattr__(self, "to_arc", np.linalg.inv(rows))

    def arcs(self, lengths: Array | Sequence[float]) -> Array:
        """Bending vectors and backbone lengths ``(..., n, 3)`` of tube lengths ``(..., 3 n)`` [m]."""
        lengths = np.asarray(lengths, dtype=np.float64)
        stacked = lengths.reshape(*lengths.shape[:-1], self.count, 3)
        arcs: Array = np.einsum("nij,...nj->...ni", self.to_arc, stacked)
        return arcs


def backbone(sections: ArcChain, lengths: Array | Sequence[float], points: int) -> Array:
    """Points from base to tip at equal arc length, rigid pieces included, shape ``(points, 3)`` [m]."""
    arcs = sections.arcs(lengths)
    # The last one is less than nothing where the tip lies behind the end of the backbone.
    pieces = np.ravel(np.column_stack((arcs[:, 2], np.maximum(sections.rigid_m, 0.0))))
    starts = np.concatenate(([0.0], np.cumsum(pieces)))
    s = np.linspace(0.0, starts[-1], points)
    curve = np.zeros((points, 3))
    origin, rotation = np.zeros(3), np.eye(3)
    for i, rigid_m in enumerate(sections.rigid_m):
        u, v, L = arcs[i]
        part = np.clip((s - starts[2 * i]) / L, 0.0, 1.0) if L > 0.0 else np.ones(points)
        along, turned = arc.pose(part * u, part * v, part * L)
        past = np.clip(s - starts[2 * i + 1], 0.0, max(rigid_m, 0.0))
        reached = s >= starts[2 * i]
        curve[reached] = (origin + (along + past[:, None] * turned[:, :, 2]) @ rotation.T)[reached]
        p, r = arc.pose(u, v, L)
        origin = origin + rotation @ (p + rigid_m * r[:, 2])
        rotation = rotation @ r
    return curve
