"""Arms of equal inextensible segments, random poses they reach, and the judge of every method.

The protocol of Feng, Renda et al., "A virtual-variable-length method for robust inverse kinematics of
multi-segment continuum robots": two to seven segments, random reachable poses, a start from the straight
arm, 1e-4, 1e-6 and 1e-8 m. Their abstract does not give lengths, the range of the bends, the measure of a
pose or the most iterations; those here are ours.

A pose is a tip, or a tip and the unit tangent there. Its error [m] is the norm of the position error and of
the difference of the tangents times a fifth of the arm's length. The forward kinematics here is formulated
apart from contid's (turn by the formula of Rodrigues, chord along the turned half angle), and no method
judges itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.tendon.geometry import BendSections
from studies.arc_chains import Goal


@dataclass(frozen=True, slots=True)
class SegmentArm:
    """An arm that starts at the origin along +z.

    Attributes:
        count: number of segments.
        length_m: of each segment.
        bend_max_rad: largest bend of a segment, of the random poses; contid has it as a limit.
    """

    count: int
    length_m: float = 0.1
    bend_max_rad: float = math.radians(120.0)

    @property
    def ell_m(self) -> float:
        """Length that a difference of unit tangents counts as [m]."""
        return 0.2 * self.count * self.length_m

    @property
    def sections(self) -> BendSections:
        """The chain for the methods that use a Jacobian; its variables are bend vectors times the length."""
        return BendSections((self.length_m,) * self.count, (0.0,) * self.count)

    def end(self, bends_rad: Array) -> tuple[Array, Array]:
        """Tip (3,) [m] and unit tangent (3,) of bend vectors ``(count, 2)`` [rad]."""
        position, frame = np.zeros(3), np.eye(3)
        for u, v in bends_rad.tolist():
            theta = math.hypot(u, v)
            axis = (-v / theta, u / theta) if theta > 0.0 else (0.0, 1.0)
            half = 0.5 * theta
            chord = self.length_m * (math.sin(half) / half if half > 0.0 else 1.0)
            position = position + chord * (frame @ _turned(axis, half)[:, 2])
            frame = frame @ _turned(axis, theta)
        return position, frame[:, 2]

    def error_m(self, bends_rad: Array, goal: Goal) -> float:
        """Distance of the arm's end from a goal [m]; see the module."""
        tip, tangent = self.end(bends_rad)
        error = float(np.linalg.norm(tip - goal.tip))
        if goal.direction is not None:
            error = math.hypot(error, self.ell_m * float(np.linalg.norm(tangent - goal.direction)))
        return error

    def goals(self, number: int, direction: bool, seed: int) -> list[Goal]:
        """Random reachable poses: bends even in [0, largest] and every azimuth alike."""
        rng = np.random.default_rng((seed, self.count, direction))
        found = []
        for _ in range(number):
            theta = rng.uniform(0.0, self.bend_max_rad, self.count)
            phi = rng.uniform(0.0, math.tau, self.count)
            tip, tangent = self.end(np.stack((theta * np.cos(phi), theta * np.sin(phi)), axis=1))
            x, y, z = tip.tolist()
            a, b, c = tangent.tolist()
            found.append(Goal((x, y, z), direction=(a, b, c) if direction else None))
        return found


def _turned(axis: tuple[float, float], angle: float) -> Array:
    """Rotation matrix about the unit axis ``(x, y, 0)``."""
    x, y = axis
    s, versed = math.sin(angle), 2.0 * math.sin(0.5 * angle) ** 2
    return np.array(
        (
            (1.0 - versed * y * y, versed * x * y, s * y),
            (versed * x * y, 1.0 - versed * x * x, -s * x),
            (-s * y, s * x, 1.0 - versed),
        )
    )
