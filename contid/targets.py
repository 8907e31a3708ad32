"""Input and output of the kinematic models: targets, poses, solutions.

Models take and return positions in the robot's *base frame*; the control loop transforms targets from the
world frame of the trajectory into it. Vectors are tuples of three floats (planar models use x and y, z is 0).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field
from numbers import Real
from types import MappingProxyType
from typing import Final, Self, TypeAlias

from contid.records import record

Vec3: TypeAlias = tuple[float, float, float]
#: Tip of a robot [m] and its direction there.
Tip: TypeAlias = tuple[Vec3, Vec3]
#: Force and moment at a point: fx, fy, fz [N], mx, my, mz [N·m].
Wrench6: TypeAlias = tuple[float, float, float, float, float, float]
#: Actuation of one robot in the order of its model's axes: lengths in m, pressures in Pa.
Actuation: TypeAlias = tuple[float, ...]

ZERO3: Final[Vec3] = (0.0, 0.0, 0.0)
#: Sine of an angle below which two vectors count as parallel.
_PARALLEL: Final = 1e-6
#: In ``limited_by`` where no limit of an axis binds: a number is not finite, or the robot ends there.
NOT_FINITE: Final = "not_finite"
REACH: Final = "reach"
#: Types of numbers; a faster question than that for `Real`.
_PLAIN: Final = frozenset((float, int))
_NO_EXTRA: Final[Mapping[str, float]] = MappingProxyType({})


def vec3(values: Iterable[float]) -> Vec3:
    """Three numbers as a vector."""
    x, y, z = values
    return x, y, z


def are_numbers(values: Sequence[object]) -> bool:
    """True when all of them are real numbers, of Python or NumPy."""
    return {*map(type, values)} <= _PLAIN or all(isinstance(value, Real) for value in values)


def load_or_zero(load_n: Vec3) -> Vec3:
    """The load of a record, zero if it has none."""
    return load_n if all(map(math.isfinite, load_n)) else ZERO3


def unit_vector(vector: Vec3) -> Vec3 | None:
    """The vector with length 1; None for the zero vector."""
    length = math.hypot(*vector)
    return (vector[0] / length, vector[1] / length, vector[2] / length) if length > 0.0 else None


def frame_of_axes(z: Vec3, x: Vec3) -> tuple[float, ...] | None:
    """Right-handed frame, row by row: its z axis, its x axis the part of ``x`` across it, y = z cross x.

    None for parallel vectors, and for one of no length.
    """
    along, beside = unit_vector(z), unit_vector(x)
    if along is None or beside is None:
        return None
    inner = along[0] * beside[0] + along[1] * beside[1] + along[2] * beside[2]
    across = (beside[0] - inner * along[0], beside[1] - inner * along[1], beside[2] - inner * along[2])
    size = math.hypot(*across)
    if size < _PARALLEL:
        return None
    (x1, x2, x3), (z1, z2, z3) = (part / size for part in across), along
    return (x1, z2 * x3 - z3 * x2, z1, x2, z3 * x1 - z1 * x3, z2, x3, z1 * x2 - z2 * x1, z3)


@record(frozen=True, slots=True)
class Target:
    """Target of one robot at one instant: one of ``tip_m``, ``actuation`` and ``arcs``, or only ``extra``.

    With ``extra`` alone the model's own axes stay where they are.

    Attributes:
        tip_m: tip position [m].
        direction: unit tangent at the tip, or None for a target of position only.
        rotation: frame of the tip, row by row, instead of a direction; None without.
        mid_m: position of the mid-point (end of the first section) [m], or None.
        actuation: the model's own axes in its own order [m or Pa].
        load_n: known force on the tip [N], in the same frame as ``tip_m``.
        extra: axes beyond the model's kinematics (wrist, gripper) by name, SI.
        measured_tip_m: externally measured tip position [m], or None; same frame as ``tip_m``.
        measured_direction: unit tangent measured there, or None.
        arcs: of every section the components u, v of its bend [rad] and its length [m], or None; length 0
            for one that the model chooses.
    """

    tip_m: Vec3 | None = None
    direction: Vec3 | None = None
    mid_m: Vec3 | None = None
    actuation: Actuation | None = None
    load_n: Vec3 = ZERO3
    extra: Mapping[str, float] = field(default_factory=lambda: _NO_EXTRA)
    measured_tip_m: Vec3 | None = None
    measured_direction: Vec3 | None = None
    rotation: tuple[float, ...] | None = None
    arcs: tuple[float, ...] | None = None


@record(frozen=True, slots=True)
class Pose:
    """Forward kinematics of one robot in its base frame.

    Attributes:
        tip_m: tip position [m].
        rotation: orientation of the tip frame, row-major 3x3 (nine numbers); its third column is the
            tangent for spatial models, its second column for planar ones, which grow along +y.
        direction: unit tangent at the tip.
        mid_m: end of the first section [m]; equals ``tip_m`` for robots of one section.
        stable: False when the equilibrium found is not a minimum of energy (loaded rods only).
    """

    tip_m: Vec3
    rotation: tuple[float, ...]
    direction: Vec3
    mid_m: Vec3
    stable: bool = True


@record(frozen=True, slots=True)
class Solution:
    """Result of an inverse model; inside the limits also for an unreachable target.

    Attributes:
        actuation: the model's axes [m or Pa].
        residual_m: distance between the target and the point ``actuation`` reaches [m] (directions scaled by
            the model's characteristic length).
        converged: True when the target is met within the model's tolerance.
        limited_by: names of the active limits, e.g. ``("right.max",)`` or ``("curvature",)``.
        iterations: steps of the solver, 0 for closed forms.
        note: remark for the user, such as by how much a limit is exceeded.
    """

    actuation: Actuation
    residual_m: float
    converged: bool
    limited_by: tuple[str, ...] = ()
    iterations: int = 0
    note: str = ""

    @classmethod
    def not_finite(cls, seed: Actuation, what: str) -> Self:
        """Answer to what is not finite, such as ``"a requested axis"``: the last command is held."""
        note = f"{what} is not finite; the last command is held"
        return cls(seed, math.inf, converged=False, limited_by=(NOT_FINITE,), note=note)
