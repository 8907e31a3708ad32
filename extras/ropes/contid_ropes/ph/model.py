"""The model of tube arms with inverse kinematics by shape: lengths along a quintic from the base to the tip.

Forward kinematics, Jacobian, shape and limits are those of `SectionModel`. The inverse takes the base, the
tip and its direction (by default that of the one circular arc to the tip); the backbone length is unknown
(end speed = mean speed) and is split between the sections as in the home posture.

One quintic is not two arcs, so the tip misses the target: by hundredths of a millimetre where the arm is one
arc, by millimetres where its sections bend to different sides. That error is the residual; up to
``solver.tolerance_mm`` of the robot file it counts as met. Lengths beyond their limits are pulled inside
(`Feasible.pulled`). The seed is used only where there is no curve.

`ShapeInverse` (Singh et al., IROS 2018) finds six tube lengths from the pose of the tip alone. One quintic
from the base to the tip represents the whole arm; the tubes are its offset curves. The backbone length and
the split between the sections may be known (measured, or from a model) or not (then: end speed = mean speed,
and the split of the geometry). When comparing methods: this one uses the *direction* of the tip, a
Newton-Raphson solver of the position does not. A tip pose (five degrees of freedom) does not determine six
lengths, but nearly their sums over the sections.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.kernels import load
from contid.kinematics.any_target import any_target
from contid.kinematics.arc.feasible import BINDING_M
from contid.kinematics.arc.section_model import SectionModel
from contid.kinematics.array import Array
from contid.robot_file.tri_tube import TriTube
from contid.targets import REACH, Actuation, Solution, Target, Vec3
from contid.units import MM_PER_M, m_to_mm


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
        length_met: False when the given backbone length was ignored: no curve has it, or it would fold the
            arm (`contid_ropes.ph.ends.plausible_energy`).
    """

    lengths_m: tuple[float, ...]
    length_met: bool


class ShapeInverse:
    """Tube lengths of one arm that starts along +z, by the kernel ``ph_curve``.

    Args:
        sections: tubes of each section, from the base on.
        split: share of each section in the backbone length; must sum to 1.

    Raises:
        KernelMissingError: It is not compiled in this installation.
    """

    def __init__(self, sections: Sequence[TubeSection], split: Sequence[float]) -> None:
        self._kernel = load("ph_curve").ShapeInverse(
            [section.distance_m for section in sections],
            [list(section.angles_rad) for section in sections],
            list(split),
        )

    def solve(self, tip_m: Vec3, direction: Vec3, length_m: float | None = None) -> ShapeSolution:
        """Tube lengths for the pose of the tip.

        Args:
            tip_m: tip position in the base frame [m].
            direction: tangent at the tip in the base frame.
            length_m: backbone length, known to about 1 % [m], or None when unknown.
        """
        found = self._kernel.solve(*tip_m, *direction, math.nan if length_m is None else length_m)
        return ShapeSolution(found.lengths_m, found.length_met)


#: In ``limited_by`` where the curve is not near enough to the target, and no limit keeps it away.
QUINTIC: Final = "quintic"
# Distances of tips [m] and lengths of directions between which the curve is computed: wider than any arm
# needs, and far from where squares underflow or overflow.
_MIN_NORM: Final = 1e-9
_MAX_NORM: Final = 1e6
#: Default tolerance [mm]: the paper's arm is reconstructed to 1.2-4.2 mm.
DEFAULT_MM: Final = 5.0


class PhModel(SectionModel):
    """A chain of constant-curvature sections, its inverse by a Pythagorean-hodograph quintic."""

    #: See `contid.kinematics.batch.BATCHES`.
    BATCH: Final = "contid.kinematics.batch.kernel"

    def __init__(self, robot: TriTube) -> None:
        super().__init__(robot)
        sections = self.sections
        # The length of the backbone of a section is the mean of its three tubes.
        home = self.feasible.home.reshape(-1, 3).mean(axis=1)
        self._inverse = ShapeInverse(
            [TubeSection(d, each) for d, each in zip(sections.radius_m, sections.angles_rad, strict=True)],
            (home / home.sum()).tolist(),
        )
        self._after_m = sections.rigid_m[-1]
        self._tolerance_m = (robot.solver.tolerance_mm or DEFAULT_MM) / MM_PER_M

    def follow(self, target: Target, answer: Actuation) -> Solution:
        """See `contid.kinematics.model.Following`."""
        return self.inverse(target, answer)

    @any_target
    def inverse(self, target: Target, seed: Actuation) -> Solution:
        """Approximate lengths inside every limit for a tip, or a tip and its direction.

        A direction enters the residual times `Tuning.ell_m`, a fifth of the arm.
        """
        if target.actuation is not None or target.tip_m is None:
            return super().inverse(target, seed)
        if target.mid_m is not None:
            raise ValueError("an arm with solver ph takes a tip, a direction or lengths, no mid-point")
        direction = target.direction or arc_direction(target.tip_m, self._after_m)
        raw = self._lengths(target.tip_m, direction)
        lengths = self.feasible.pulled(seed if raw is None else raw)
        actuation: Actuation = tuple(lengths.tolist())
        pose = self.forward(actuation)
        residual_m = math.dist(pose.tip_m, target.tip_m)
        if target.direction is not None:
            residual_m = math.hypot(
                residual_m, self.tuning.ell_m * math.dist(pose.direction, target.direction)
            )
        limits: tuple[str, ...] = ()
        if raw is None or float(np.abs(lengths - raw).max()) > BINDING_M:
            limits = self.feasible.named(self.feasible.binding(lengths))
        if residual_m <= self._tolerance_m:
            return Solution(actuation, residual_m, True, limits)
        limits = limits or (REACH if raw is None else QUINTIC,)
        within = f"solver ph counts up to {m_to_mm(self._tolerance_m):g} mm as met"
        if raw is None:
            note = "there is no curve to this tip; lengths stay where they are"
        else:
            note = f"the quintic's lengths leave {m_to_mm(residual_m):.6g} mm; {within}"
        return Solution(actuation, residual_m, False, limits, note=note)

    def _lengths(self, tip_m: Vec3, direction: Vec3) -> Array | None:
        """Lengths along the quintic, inside the limits or not; None when there is none."""
        away = math.hypot(*tip_m)
        turn = math.hypot(*direction)
        if not (_MIN_NORM < away < _MAX_NORM and _MIN_NORM < turn < _MAX_NORM):  # NaN included
            return None
        x, y, z = direction
        a, b, c = tip_m
        leg = self._after_m / turn
        found = np.array(self._inverse.solve((a - leg * x, b - leg * y, c - leg * z), direction).lengths_m)
        return found if np.isfinite(found).all() else None


def arc_direction(tip_m: Vec3, rigid_m: float = 0.0) -> Vec3:
    """Unit tangent at a tip that one arc from the base, along +z, reaches after a rigid piece.

    ``t = 2 c (x, y, c) / (x^2 + y^2 + c^2) - e_z`` with ``c = z + h``; not a number where there is none.

    The sum ``t + e_z`` of the tangents at both ends of an arc is parallel to its chord p. The tip is
    ``p + h t``, so ``tip + h e_z = (x, y, c)`` is parallel to p as well.
    """
    x, y, z = tip_m
    c = z + rigid_m
    square = x * x + y * y + c * c
    if not 0.0 < square < math.inf:
        return (math.nan, math.nan, math.nan)
    share = 2.0 * c / square
    return (share * x, share * y, share * c - 1.0)
