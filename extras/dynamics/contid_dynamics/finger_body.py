"""A simulated finger at rest between its servos, the dry friction of their gears, and an elastic object.

A shaft at the angle q stands still while

    |K (q0 - q) + F (n . J) / N| <= friction [A],     F = k max(0, depth)

with the stiffness K of its servo [A/rad], the torque N per current [N m/A], the derivative J of the tip by q
[m/rad], and stiffness k, outward normal n and force F of the object; q0 is the angle of the servo without a
load. A shaft that violates this moves just so far that it holds again: dry friction with its memory, solved
by sweeps over the shafts. The tip is the integral of the direction along the arc by Gauss-Legendre, J a
central difference.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from contid.robot_file.rack_finger import RackFinger
from contid.units import MM_PER_M

#: Nodes and weights of Gauss-Legendre on [0, 1] with five points (Abramowitz and Stegun, table 25.4).
_NODES: Final = (0.046910077030668, 0.230765344947158, 0.5, 0.769234655052842, 0.953089922969332)
_WEIGHTS: Final = (
    0.118463442528095,
    0.239314335249683,
    0.284444444444444,
    0.239314335249683,
    0.118463442528095,
)
#: Step of the central difference [rad].
_STEP: Final = 1e-4
#: Sweeps end when no shaft moves by more than this [rad].
_STILL: Final = 1e-10
_SWEEPS: Final = 200
#: Times that the tip is linearised anew in one equilibrium.
_LINEARISED: Final = 20


class Shaft(NamedTuple):
    """Angle of a shaft, and the current of its servo."""

    angle_rad: float
    current_a: float


class FingerBody:
    """The shafts of one finger.

    Args:
        robot: its name.
        description: description with a ``sim``.

    Attributes:
        axes: names of its axes on the bus.
        friction_a: friction torque of every gear [A].
        noise_a: standard deviation of a measured current [A].
        push_n: force of the object on the tip [N].
    """

    def __init__(self, robot: str, description: RackFinger) -> None:
        assert description.sim is not None
        self._robot = description
        self._sim = description.sim
        self.axes = [f"{robot}.{axis}" for axis in description.axis_names]
        self.friction_a = self._sim.friction_ma / 1e3
        self.noise_a = self._sim.noise_ma / 1e3
        self.push_n = 0.0
        self._stiffness = math.degrees(self._sim.stiffness_ma_per_deg / 1e3)
        self._shafts: list[float] = []
        self._normal, self._surface_mm = (0.0, 0.0, 0.0), 0.0
        if self._sim.object is not None:
            self._normal, self._surface_mm = self._sim.object.in_base(description.base)

    def settle(self, free_rad: list[float], t_s: float) -> list[Shaft]:
        """The shafts at rest under the push of the object.

        Args:
            free_rad: angles of the servos without a load.
            t_s: time since the bus was opened.
        """
        if not self._shafts:
            self._shafts = list(free_rad)
        shafts, thing = self._shafts, self._sim.object
        present = thing is not None and (thing.until_s is None or t_s < thing.until_s)
        k = thing.stiffness_n_per_mm * MM_PER_M if thing is not None and present else 0.0
        for _ in range(_LINEARISED):
            gap_m, along = (self._gap_m(shafts), self._along()) if present else (1.0, [0.0] * len(shafts))
            moved = self._slide(free_rad, k, gap_m, along)
            if moved < _STILL or not present:
                break
        gap_m = self._gap_m(shafts) if present else 1.0
        self.push_n = k * max(0.0, -gap_m)
        return [Shaft(q, self._stiffness * (free - q)) for q, free in zip(shafts, free_rad, strict=True)]

    def _slide(self, free_rad: list[float], k: float, gap_m: float, along: list[float]) -> float:
        """Let the shafts move until friction holds them; returns the largest motion [rad].

        The tip is linear in the angles here: ``gap_m`` is its distance from the object at the present ones,
        ``along`` the change of that distance per rotation of every shaft [m/rad].
        """
        shafts, torque = self._shafts, self._sim.nm_per_a
        begin = list(shafts)
        for _ in range(_SWEEPS):
            most = 0.0
            for i, free in enumerate(free_rad):
                push = k * max(0.0, -gap_m)
                net = self._stiffness * (free - shafts[i]) + push * along[i] / torque
                over = abs(net) - self.friction_a
                if over <= 0.0:
                    continue
                yielding = self._stiffness + (k * along[i] ** 2 / torque if push > 0.0 else 0.0)
                step = math.copysign(over / yielding, net)
                shafts[i] += step
                gap_m += along[i] * step
                most = max(most, abs(step))
            if most < _STILL:
                break
        return max(abs(a - b) for a, b in zip(shafts, begin, strict=True))

    def tip_mm(self, shafts: list[float]) -> tuple[float, float]:
        """The tip in the base frame of the finger [mm], for angles of the shafts [rad]."""
        robot = self._robot
        lengths = []
        for axis, angle in zip(robot.axis_names, shafts, strict=True):
            wiring = robot.axes[axis]
            turns = (math.degrees(angle) - wiring.zero_deg) / 360.0
            lengths.append(turns * (wiring.mm_per_rev or 0.0) * wiring.direction)
        left, right = lengths
        arc = 0.5 * (left + right)
        bend = (right - left) / robot.geometry.rack_spacing_mm
        if robot.correction is not None:
            low, high = robot.correction.arc_length_mm
            bend *= 1.0 + robot.correction.a_per_mm * min(max(arc, low), high) + robot.correction.b
        x = arc * sum(w * math.sin(bend * s) for s, w in zip(_NODES, _WEIGHTS, strict=True))
        y = arc * sum(w * math.cos(bend * s) for s, w in zip(_NODES, _WEIGHTS, strict=True))
        tip = robot.geometry.tip_length_mm
        return x + tip * math.sin(bend), y + tip * math.cos(bend)

    def _gap_m(self, shafts: list[float]) -> float:
        """Distance of the tip from the object; negative inside."""
        x, y = self.tip_mm(shafts)
        return (self._normal[0] * x + self._normal[1] * y - self._surface_mm) / MM_PER_M

    def _along(self) -> list[float]:
        """Motion of the tip out of the object per rotation of every shaft [m/rad]."""
        out = []
        for i in range(len(self._shafts)):
            ends = []
            for step in (-_STEP, _STEP):
                at = list(self._shafts)
                at[i] += step
                ends.append(self._gap_m(at))
            out.append((ends[1] - ends[0]) / (2.0 * _STEP))
        return out
