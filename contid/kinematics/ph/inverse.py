"""Inverse kinematics by shape (Singh et al., IROS 2018): six tube lengths from the pose of the tip alone.

One quintic from the base to the tip represents the whole arm; the tubes are its offset curves. The backbone
length and the split between the sections may be known (measured, or from a model) or not (then: end speed =
mean speed, and the split of the geometry).

When comparing methods: this one uses the *direction* of the tip, a Newton-Raphson solver of the position does
not. A tip pose (five degrees of freedom) does not determine six lengths, but nearly their sums over the
sections.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from contid.kernels import load
from contid.kinematics.ph.ends import CurveEnds, through_rough
from contid.kinematics.ph.tubes import section_bending, tube_lengths
from contid.targets import ZERO3, Vec3

_BASE_DIRECTION: Vec3 = (0.0, 0.0, 1.0)


@dataclass(frozen=True, slots=True)
class TubeSection:
    """Where the tubes of one section run: distance from the backbone [m] and directions [rad]."""

    distance_m: float
    angles_rad: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class ShapeSolution:
    """Answer of the inverse kinematics by shape.

    Attributes:
        lengths_m: tube lengths, section by section [m].
        length_met: False when the given backbone length was ignored
            (`contid.kinematics.ph.ends.through_rough`).
    """

    lengths_m: tuple[float, ...]
    length_met: bool


def ph_inverse(
    tip_m: Vec3,
    direction: Vec3,
    sections: Sequence[TubeSection],
    split: Sequence[float],
    length_m: float | None = None,
) -> ShapeSolution:
    """Tube lengths of an arm that starts along +z, in NumPy: specification of the kernel.

    Args:
        tip_m: tip position in the base frame [m].
        direction: tangent at the tip in the base frame.
        sections: tubes of each section, from the base on.
        split: share of each section in the backbone length; must sum to 1.
        length_m: backbone length [m], or None when unknown.
    """
    fit = through_rough(CurveEnds(ZERO3, tip_m, _BASE_DIRECTION, direction), length_m)
    backbone = fit.curve.length_m * np.array(split)
    joints = np.concatenate([[0.0], fit.curve.parameter_at(np.cumsum(backbone)[:-1]), [1.0]])
    distance = np.array([section.distance_m for section in sections])
    angles = np.array([section.angles_rad for section in sections])
    lengths = tube_lengths(backbone, section_bending(fit.curve, joints), distance, angles)
    return ShapeSolution(tuple(lengths.reshape(-1).tolist()), fit.length_met)


class ShapeInverse:
    """`ph_inverse` for one arm, compiled where possible, else NumPy; they agree to 1e-12 m."""

    def __init__(self, sections: Sequence[TubeSection], split: Sequence[float]) -> None:
        self._sections = tuple(sections)
        self._split = tuple(split)
        kernel = load("ph_curve")
        self._kernel = kernel and kernel.ShapeInverse(
            [section.distance_m for section in sections],
            [list(section.angles_rad) for section in sections],
            list(split),
        )

    @property
    def compiled(self) -> bool:
        """True when the kernel is used."""
        return self._kernel is not None

    def solve(self, tip_m: Vec3, direction: Vec3, length_m: float | None = None) -> ShapeSolution:
        """Tube lengths for the pose of the tip; see `ph_inverse`."""
        if self._kernel is None:
            return ph_inverse(tip_m, direction, self._sections, self._split, length_m)
        length = math.nan if length_m is None else length_m
        return ShapeSolution(*self._kernel.solve(*tip_m, *direction, length))
