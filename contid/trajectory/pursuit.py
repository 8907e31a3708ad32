"""Jerk-limited motion of several axes to a goal that moves: the state after a time, from any state.

The motion is that of ruckig in the frame that moves with the goal at its present velocity, where the goal
rests: time-optimal, with every axis there at the same instant. Its state is asked anew in every tick, from
the state before, so the motion is continuous to the acceleration and its jerk stays within its limit,
whatever the goal does. It is compiled: ``contid/kernels/motion/pursuit.hpp``.
"""

from __future__ import annotations

import enum
from collections.abc import Sequence
from typing import NamedTuple

from contid.kernels import load
from contid.targets import Actuation


class Lines(enum.IntEnum):
    """Straight lines of axes whose present rates allow them, by versions of the rules of motions.

    ``Lines`` of ``contid/kernels/motion/pursuit.hpp``.
    """

    NONE = 0
    ROUNDED = 1
    EXACT = 2


class MovingAxes(NamedTuple):
    """Position [m or Pa], velocity [m/s or Pa/s] and acceleration [m/s^2 or Pa/s^2] of every axis."""

    position: Actuation
    velocity: Actuation
    acceleration: Actuation


class AxisRates(NamedTuple):
    """Greatest velocity, acceleration and jerk of every axis [m or Pa, per s, s^2 and s^3]."""

    velocity: Sequence[float]
    acceleration: Sequence[float]
    jerk: Sequence[float]


def frame_velocity(pace: Sequence[float], rates: AxisRates) -> Actuation:
    """Velocity of the frame of a goal that moves by a pace [m/s or Pa/s]; 0 where an axis has jumped."""
    found: Actuation = load("limiter").frame_velocity(pace, rates)
    return found


def pursued(
    state: MovingAxes,
    goal: Actuation,
    frame: Actuation,
    rates: AxisRates,
    time_s: float,
    together: bool = True,
    *,
    straight: Lines = Lines.NONE,
) -> MovingAxes | None:
    """The state after ``time_s`` on the way to a goal; None where ruckig finds no motion.

    Args:
        state: now.
        goal: where the goal will be after ``time_s``, if it goes on.
        frame: its velocity (`frame_velocity`).
        rates: limits of the axes.
        time_s: a tick.
        together: every axis arrives at the same instant, else each as early as it can.
        straight: the straight line where the present rates allow it, with ``together``.
    """
    found = load("limiter").pursued(state, goal, frame, rates, time_s, together, straight)
    return None if found is None else MovingAxes(*found)


def braked(
    state: MovingAxes, rates: AxisRates, time_s: float, together: bool, straight: Lines = Lines.NONE
) -> MovingAxes | None:
    """The state after ``time_s`` of the shortest stop, ``together`` or of every axis by itself."""
    found = load("limiter").braked(state, rates, time_s, together, straight)
    return None if found is None else MovingAxes(*found)
