"""The chain of arcs of a tendon robot, in the variables of its solver: bends times lengths.

The variables of section s are ``x_s = L_s Theta_s`` [m], which move the tip by about their own size, so that
the solver of arcs works with its own tolerances. The length of the backbone does not change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from contid.kinematics.arc.sections import ArcChain
from contid.kinematics.array import Array
from contid.kinematics.tendon.geometry import TendonGeometry


@dataclass(frozen=True, eq=False)
class BendSections(ArcChain):
    """See the module; the base offset is left to the caller.

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
