"""The jerk-limited stop with which the guard of a live stream compares what it commands.

A robot that follows live targets can always make it inside the limits that its axes share. Axes on a straight
line, such as that of an approach, stay on the line, which `contid.trajectory.standstill` leaves; the line is
inside limits that are convex. It is compiled: ``contid/kernels/limiter/joint_stop.hpp``.
"""

from __future__ import annotations

from typing import Any

from contid.kernels import load
from contid.trajectory.pursuit import AxisRates, MovingAxes
from contid.trajectory.standstill import MotionState


class JointStop:
    """A motion to a standstill, of all axes at the same instant.

    Args:
        begin: position and rates of every axis.
        rates: limits of the axes.
        straight: on the line of rates that are parallel.

    Attributes:
        duration_s: time until every axis rests.
    """

    def __init__(self, begin: MovingAxes, rates: AxisRates, *, straight: bool = True) -> None:
        self._begin = begin
        self._motion: Any = load("limiter").JointStopMotion(begin, *rates, straight)
        self.duration_s: float = self._motion.duration_s

    def at(self, time_s: float) -> MotionState:
        """The state ``time_s`` after the start; the start before it, rest at the end after."""
        if time_s <= 0.0:
            return MotionState(self._begin.position, self._begin.velocity)
        position, velocity = self._motion.at_time(min(time_s, self.duration_s))
        return MotionState(position, velocity if time_s < self.duration_s else (0.0,) * len(velocity))
