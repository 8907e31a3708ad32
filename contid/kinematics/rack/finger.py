"""Two-rack finger: a planar constant-curvature arc between two racks (Morita et al., section III).

With racks L1 (left) and L2 (right), rack spacing w and straight tip h::

    S = (L1 + L2)/2      theta_cmd = (L2 - L1)/w      theta = theta_cmd (1 + a S + b)
    x = S cosc(theta) + h sin(theta)      y = S sinc(theta) + h cos(theta)

Eq. 1 and 3; the radius r of Eq. 2, whose printed formula mixes mm and mm^2, is never formed. theta > 0 bends
to +x. The curvature correction is Eq. 5 and 10; its S is clamped to the range in which a and b were
identified.

The inverse has a closed form, although the paper doubts it: all arcs that end at a point share one circle
``k = 2x/(x^2 + y^2 - h^2)``, and within the finger's limits exactly one of them fits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from contid.kernels import load
from contid.kinematics.any_target import any_target
from contid.kinematics.array import Array
from contid.kinematics.rack.finger_limits import RackFingerEnvelope
from contid.kinematics.rack.planar_arc import cosc, cosc_derivative, sinc, sinc_derivative
from contid.robot_file.rack_finger import RackFinger
from contid.targets import ZERO3, Actuation, Pose, Solution, Target, Vec3
from contid.units import LIMIT_TOLERANCE_M, MM_PER_M, m_to_mm

# A target met to this distance counts as met [m]; the closed form is exact to ~1e-16 m.
_TOLERANCE_M: Final = 1e-9
# Rounds of the length that a bend needs; the correction changes by less than a percent per mm.
_ROUNDS: Final = 8


class RackFingerModel:
    """Forward and inverse kinematics of one finger; see the module for the equations."""

    dimension = 2

    def __init__(self, robot: RackFinger) -> None:
        self.axis_names = robot.axis_names
        self.lower = robot.lower
        self.upper = robot.upper
        self.rack_spacing_m = robot.geometry.rack_spacing_mm / MM_PER_M
        self.tip_length_m = robot.geometry.tip_length_mm / MM_PER_M
        correction = robot.correction
        self.gain_per_m, self.gain_offset = 0.0, 0.0
        self.gain_range_m = (0.0, math.inf)
        if correction is not None:
            self.gain_per_m = correction.a_per_mm * MM_PER_M
            self.gain_offset = correction.b
            least_mm, greatest_mm = correction.arc_length_mm
            self.gain_range_m = (least_mm / MM_PER_M, greatest_mm / MM_PER_M)
        self.envelope = RackFingerEnvelope(
            rack_spacing_m=self.rack_spacing_m,
            length_min_m=self.lower[0],
            length_max_m=self.upper[0],
            curvature_max_per_m=robot.curvature_max_per_m,
            arc_length_min_m=robot.limits.arc_length_min_mm / MM_PER_M,
            curvature_gain=self.curvature_gain,
        )
        #: The limits that both racks share (``contid/kernels/limiter/shared_bend.hpp``).
        self.shared: Any = load("limiter").SharedBend(
            self.rack_spacing_m, self.envelope.curvature_max_per_m, self.envelope.arc_length_min_m,
            self.gain_per_m, self.gain_offset, *self.gain_range_m,
        )  # fmt: skip
        #: One row or many, within the limits (``contid/kernels/finger/finger.hpp``).
        self.kernel: Any = load("finger").Finger(
            self.rack_spacing_m, self.tip_length_m, self.gain_per_m, self.gain_offset, *self.gain_range_m,
            self.envelope.length_min_m, self.envelope.length_max_m, self.envelope.curvature_max_per_m,
            self.envelope.arc_length_min_m,
        )  # fmt: skip
        #: What is out of reach (``contid/kernels/finger/boundary.hpp``).
        self._boundary: Any = load("finger").Boundary(self.kernel, self.envelope.pieces)
        self._rest_m = robot.section_lengths[0].rest_m

    def curvature_gain(self, arc_length_m: float) -> float:
        """Actual over commanded curvature, ``1 + a S + b``, S clamped to its identified range (Eq. 5, 10)."""
        least, greatest = self.gain_range_m
        return 1.0 + self.gain_per_m * min(max(arc_length_m, least), greatest) + self.gain_offset

    def arc(self, actuation: Actuation) -> tuple[float, float]:
        """Arc length S [m] and actual turning angle theta [rad] of two rack lengths [m]."""
        left, right = actuation
        arc_length_m = 0.5 * (left + right)
        return arc_length_m, (right - left) / self.rack_spacing_m * self.curvature_gain(arc_length_m)

    def forward(self, actuation: Actuation, load_n: Vec3 = ZERO3) -> Pose:
        """Tip of the finger for rack lengths [m] (Eq. 4); a load does not bend racks in this model."""
        x, y, sin, cos = self.kernel.forward(*actuation)
        tip = (x, y, 0.0)
        return Pose(tip, (cos, sin, 0.0, -sin, cos, 0.0, 0.0, 0.0, 1.0), (sin, cos, 0.0), tip)

    def jacobian(self, actuation: Actuation, load_n: Vec3 = ZERO3) -> Array:
        """Derivative of the tip by the racks, shape (3, 2); regular on the straight line, unlike Eq. 6."""
        left, right = actuation
        arc_length_m, theta = self.arc(actuation)
        gain = self.curvature_gain(arc_length_m)
        least, greatest = self.gain_range_m
        gain_slope = self.gain_per_m if least < arc_length_m < greatest else 0.0
        bend, shear = gain / self.rack_spacing_m, 0.5 * (right - left) / self.rack_spacing_m * gain_slope
        theta_by_rack = np.array([-bend + shear, bend + shear])
        tip_by_theta = np.array(
            [
                arc_length_m * cosc_derivative(theta) + self.tip_length_m * math.cos(theta),
                arc_length_m * sinc_derivative(theta) - self.tip_length_m * math.sin(theta),
                0.0,
            ]
        )
        tip_by_length = np.array([cosc(theta), sinc(theta), 0.0])
        return np.outer(tip_by_length, (0.5, 0.5)) + np.outer(tip_by_theta, theta_by_rack)

    def shape(self, actuation: Actuation, points: int, load_n: Vec3 = ZERO3) -> Array:
        """Backbone at equal steps of S + h, shape (points, 3) [m]: the arc, then the straight tip."""
        found = np.empty((points, 3))
        self.kernel.shape(*actuation, found)
        return found

    def solve_arc(self, x_m: float, y_m: float) -> tuple[float, float] | None:
        """Arc length S [m] and actual curvature k [1/m] of the one arc that ends at a tip position.

        ``d = x^2 + y^2 - h^2 > 0`` is the open branch; d < 0 is a tip curled back inside radius h. None when
        no arc with |theta| < 2 pi ends there (d = 0 other than (0, h); x = 0 behind the base).
        """
        h = self.tip_length_m
        # (y - h)(y + h) keeps the digits that y^2 - h^2 loses.
        d = x_m * x_m + (y_m - h) * (y_m + h)
        rho = math.hypot(x_m, y_m + h)
        if d == 0.0 or rho == 0.0:
            return (0.0, 0.0) if (x_m == 0.0 and y_m == h) else None
        theta = 2.0 * math.atan2(x_m, y_m + h)
        curvature = 2.0 * x_m / d
        if d > 0.0:
            half = sinc(0.5 * theta)
            # x = 0 below the base: atan2 gives a half turn of zero radius, which no arc has.
            return (d / (rho * half), curvature) if abs(theta) < 2.0 * math.pi else None
        # A curled tip on the y axis needs an arc of infinite length; next to it, one longer than any double.
        arc_length_m = (
            (theta - math.copysign(2.0 * math.pi, x_m)) / curvature if curvature != 0.0 else math.inf
        )
        return (arc_length_m, curvature) if math.isfinite(arc_length_m) else None

    def arcs(self, actuation: Actuation, load_n: Vec3 = ZERO3) -> Array:
        """Bend to +x and length of the arc (`contid.kinematics.model.Bending`)."""
        arc_length_m, theta = self.arc(actuation)
        return np.array([[theta, 0.0, arc_length_m]])

    def of_arcs(self, arcs: Sequence[float], seed: Actuation, load_n: Vec3 = ZERO3) -> Actuation:
        """Racks that have this bend (`contid.kinematics.model.Bending`).

        A length that is left open is the one nearest to that of the rest pose within the limits; the
        correction of the curvature depends on it, so it is a fixed point.
        """
        theta, _, given_m = arcs
        arc_length_m = given_m or self._rest_m
        bend = self._rack_bend(theta, arc_length_m)
        for _ in range(0 if given_m else _ROUNDS):
            least = max(self.lower[0] + abs(bend), abs(theta) / self.envelope.curvature_max_per_m)
            arc_length_m = min(max(self._rest_m, least), self.upper[0] - abs(bend))
            bend = self._rack_bend(theta, arc_length_m)
        return arc_length_m - bend, arc_length_m + bend

    def _rack_bend(self, theta: float, arc_length_m: float) -> float:
        """Half the difference of the racks for a bend [rad] of an arc [m]."""
        return 0.5 * self.rack_spacing_m * theta / self.curvature_gain(arc_length_m)

    @any_target
    def inverse(self, target: Target, seed: Actuation) -> Solution:
        """Rack lengths for a tip position, closed form; the nearest reachable point when it is out of reach.

        Curvature correction divides: ``k_cmd = k/(1 + a S + b)``; S is untouched, so nothing iterates.
        """
        if target.actuation is not None:
            return self._clamped(target.actuation)
        if target.tip_m is None:
            raise ValueError("a rack finger takes a tip position or rack lengths")
        met = self.kernel.inverse(*target.tip_m[:2])
        if met is not None:
            actuation, residual_m = met
            return Solution(actuation, residual_m, converged=True)
        arc = self.solve_arc(*target.tip_m[:2])
        if arc is None:
            return self._nearest(target.tip_m, ("no_arc",), "no arc of this finger ends there")
        exceeded = self.envelope.exceeded(*arc)
        return self._nearest(target.tip_m, tuple(exceeded), "; ".join(exceeded.values()))

    def _distance(self, actuation: Actuation, tip_m: Vec3) -> float:
        x, y, *_ = self.kernel.forward(*actuation)
        return math.hypot(x - tip_m[0], y - tip_m[1])

    def _nearest(self, tip_m: Vec3, limits: tuple[str, ...], note: str) -> Solution:
        """The reachable point closest to a target out of reach: on the boundary of the limits."""
        actuation: Actuation = self._boundary.nearest(*tip_m[:2])
        residual = self._distance(actuation, tip_m)
        return Solution(
            actuation,
            residual,
            converged=residual < _TOLERANCE_M,
            limited_by=limits,
            note=f"{note}; the nearest reachable point is {m_to_mm(residual):.6g} mm away",
        )

    def _clamped(self, requested: Actuation) -> Solution:
        actuation = self.kernel.clamp(*requested)
        off = max([abs(a - w) for a, w in zip(actuation, requested, strict=True)])
        if off <= LIMIT_TOLERANCE_M:
            return Solution(actuation, 0.0, converged=True)
        reached, goal = self.forward(actuation).tip_m, self.forward(requested).tip_m
        names = self.envelope.binding(actuation)
        note = f"racks moved by {m_to_mm(off):.6g} mm to stay inside the limits"
        return Solution(actuation, math.dist(reached, goal), converged=False, limited_by=names, note=note)
