"""How much gain the closed loop on the tip bears beside a body that swings.

The loop of `contid.control.tick.tip_feedback` is, about a place at rest and for changes of the tip,

    d = K / (s + K) (e + (1 - B exp(-s late)) A S d),    B = w^2 / (s^2 + 2 z w s + w^2),

where the body B answers what the axes are at, A is the dead time and lag from commands to axes, S the shaping
of commands, and ``late`` how old a measured tip is beside the axes that it is compared with. The roots reach
the imaginary axis where

    K = -j u / (1 + A S (B exp(-j u late) - 1))

is a positive number for s = j u. Below the least such K the loop is stable; without A, S and a late tracker
it is ``2 z w``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from contid.errors import ContidError
from contid.robot_file.rates import Impulse
from contid_dynamics.report import pose_modes

if TYPE_CHECKING:
    from contid.robot_file.robot import RobotDescription

#: Measured tips are at most so much older than the axes that they are compared with [s].
LATE_S: Final = 0.05
#: Frequencies beside the stated ones for which a loop has to be stable.
OFF: Final = (0.8, 1.0, 1.2)
_OFF_TEXT: Final = f"frequencies 20 % off and tips up to {1e3 * LATE_S:.0f} ms late"
#: Rates that are tried, as shares of that of the body, and how many.
_RATES: Final = (0.02, 30.0, 6000)


def highest_gain(
    frequency_hz: float,
    ratio: float,
    parts: Sequence[Impulse] = (),
    delay_s: float = 0.0,
    lag_s: float = 0.0,
    late_s: float = 0.0,
) -> float:
    """The gain [1/s] from which on the loop is unstable; infinite where there is none.

    Args:
        frequency_hz: damped frequency of the body.
        ratio: its damping ratio, below 1.
        parts: of a shaped command.
        delay_s: dead time from commands to axes.
        lag_s: time constant of the axes behind that.
        late_s: age of measured tips.
    """
    body = 2.0 * math.pi * frequency_hz / math.sqrt(1.0 - ratio * ratio)
    rates = body * np.geomspace(*_RATES)
    s = 1j * rates
    whole = sum(part.size for part in parts)
    shaped = sum(part.size / whole * np.exp(-s * part.after_s) for part in parts) if parts else 1.0
    axes = np.exp(-s * delay_s) / (1.0 + s * lag_s)
    swings = body**2 / (s**2 + 2.0 * ratio * body * s + body**2)
    gains = -s / (1.0 + axes * shaped * (swings * np.exp(-s * late_s) - 1.0))
    turns = np.flatnonzero((gains.imag[:-1] > 0.0) != (gains.imag[1:] > 0.0))
    low, high = gains[turns], gains[turns + 1]
    found = low.real + (high.real - low.real) * low.imag / (low.imag - high.imag)
    # Through infinity the sign changes as well, on the way from one side to the other.
    through = (low.real > 0.0) != (high.real > 0.0)
    return float(min(found[(found > 0.0) & ~through], default=math.inf))


def feedback_line(robot: RobotDescription) -> str:
    """Which gain the tip feedback of a robot bears, one sentence; empty without feedback or a known body.

    The body is that of ``rates.shape``, else the slowest mode of ``dynamics`` at rest.

    Raises:
        ContidError: the loop is unstable with the numbers of the file as they are.
    """
    dynamics = getattr(robot, "dynamics", None)
    if robot.feedback is None:
        return ""
    bodies = _bodies(robot)
    acting = [(0.0, 0.0)]
    if dynamics is not None:
        acting.append((1e-3 * max(dynamics.delay_ms), 1e-3 * max(dynamics.lag_ms)))
    gains = {
        (off, late_s): min(
            highest_gain(off * body.frequency_hz, body.ratio, body.parts, *axes, late_s)
            for body in bodies
            for axes in acting
        )
        for off in OFF
        if bodies
        for late_s in (0.0, 0.5 * LATE_S, LATE_S)
    }
    if not gains:
        return ""
    gain_per_s, least = robot.feedback.gain_per_s, min(gains.values())
    if gain_per_s >= gains[1.0, 0.0]:
        raise ContidError(
            f"gain_per_s {gain_per_s:g} makes the body swing ever more, from {gains[1.0, 0.0]:.2g} on: "
            f"give gain_per_s: {0.5 * least:.2g}, which bears {_OFF_TEXT}"
        )
    return gain_line(gain_per_s, least)


def gain_line(gain_per_s: float, least: float) -> str:
    """A gain beside the one from which on the loop is unstable, one sentence."""
    if math.isinf(least):
        return f"gain_per_s {gain_per_s:g} is stable with {_OFF_TEXT}, as every other gain"
    if gain_per_s < least:
        return (
            f"gain_per_s {gain_per_s:g} is {least / gain_per_s:.1f} times below instability with {_OFF_TEXT}"
        )
    return (
        f"gain_per_s {gain_per_s:g} makes the body swing ever more, with {_OFF_TEXT}: "
        f"give feedback.gain_per_s: {0.5 * least:.2g}, half of what is unstable"
    )


class _Body(NamedTuple):
    """A body that swings: damped frequency, damping ratio, and how commands to it are shaped."""

    frequency_hz: float
    ratio: float
    parts: Sequence[Impulse] = ()


def _bodies(robot: RobotDescription) -> list[_Body]:
    shape = robot.rates.shape
    if shape is None:
        if getattr(robot, "dynamics", None) is None:
            return []
        try:
            (mode,) = pose_modes(robot, robot.rest[: len(robot.axis_names)], 1).modes
        except (ArithmeticError, ContidError):
            return []
        return [_Body(mode.frequency_hz, mode.ratio)] if mode.ratio < 1.0 else []
    if shape.schedule is None:
        return [_Body(shape.frequency_hz, shape.damping_ratio, shape.impulses())]
    between = np.geomspace(shape.schedule.least_hz, shape.schedule.most_hz, 5).tolist()
    return [_Body(hz, shape.damping_ratio, shape.impulses((0.9 * hz, 1.1 * hz))) for hz in between]
